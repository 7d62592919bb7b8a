"""Scripts in live sessions. Each test has a session of its own, with real programs."""

import csv
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

import tactus
from support import BIN, SOURCE, FolderTest

SCENARIO = """name: recorded
duration: 60
users:
  - name: ann
    script: [{approach: {object: "#1", direction: [0, 0, 1], speed: 0.2}}, {hold: {seconds: 50, force: 1}}]
"""


class SessionTest(FolderTest):
    count = 0

    @classmethod
    def setUpClass(cls):
        cls.wall = tactus.build(tactus.Mesh.generate("wall", faces=8000))

    def setUp(self):
        super().setUp()
        SessionTest.count += 1
        self.domain = self.reserved_domain()
        self.session = f"python.{os.getpid()}.{SessionTest.count}"
        self.wall.save(self.folder / "wall.spm")
        (self.folder / "wall.yaml").write_text("objects:\n  - {model: wall.spm, material: {stiffness: 700}}\n")

    def reserved_domain(self):
        """Returns the first of three domains that no other test uses until this one ends: 4, 7, ... or 94.

        tests/support/test_domain.hpp reserves domains by the same names.
        """
        reservation = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.addCleanup(reservation.close)
        for tried in range(31):
            domain = 4 + 3 * ((os.getpid() + tried) % 31)
            try:
                reservation.bind(f"\0tactus.test.domain.{domain}")
                return domain
            except OSError:  # another test uses it
                pass
        self.fail("other tests use all domains")

    def start(self, program, *arguments):
        """Starts a program in the session, and ends it after the test."""
        log = open(self.folder / f"{program}.log", "ab")
        process = subprocess.Popen([BIN / f"tactus-{program}", *arguments, "--session", self.session, "--domain",
                                    str(self.domain)], cwd=self.folder, stdout=log, stderr=log)

        def end():
            process.kill()
            process.wait()
            log.close()
        self.addCleanup(end)
        return process

    def join(self, **options):
        session = tactus.Session(self.session, domain=self.domain, **options)
        self.addCleanup(session.close)
        return session

    def start_wall(self):
        """Starts a host and an HRTC, and returns their processes."""
        return [self.start("host", "--config", "wall.yaml", "--name", "museum"), self.start("hrtc", "--name", "desk")]

    def test_a_script_sees_participants_objects_figures_and_states(self):
        session = self.join()
        self.start_wall()
        (self.folder / "hold.yaml").write_text(SCENARIO)
        self.start("sim", "--scenario", "hold.yaml")
        session.wait(lambda: session.state("ann") is not None and session.state("ann")["in_contact"], 30)
        session.wait(lambda: {"museum", "desk"} <= session.figures.keys())
        self.assertEqual({name: one["role"] for name, one in session.participants.items()},
                         {"museum": "host", "desk": "hrtc", "sim": "client"})
        self.assertEqual(session.participants["sim"]["users"], ["ann"])
        self.assertEqual((session.participants["desk"]["served_users"], session.users), (["ann"], ["ann"]))
        wall = session.objects["wall"]
        self.assertEqual((wall["host"], wall["stiffness"], wall["digest"]), ("museum", 700, self.wall.summary.digest))
        np.testing.assert_array_equal(wall["bounds"], self.wall.summary.bounds)
        self.assertGreater(session.figures["desk"]["hrtc.cycles"], 100)
        states = session.states("ann")
        self.assertGreater(len(states), 10)
        self.assertTrue((np.diff(states["session_time_ns"]) > 0).all())
        self.assertEqual(states[-1]["object_id"], tactus.id_of("wall"))
        self.assertIsNone(session.state("nobody"))

    def test_the_example_measures_the_stiffness_of_the_material(self):
        self.start_wall()
        done = subprocess.run([sys.executable, SOURCE / "examples/python/join.py", self.session, str(self.domain)],
                              cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertAlmostEqual(float(re.search(r"stiffness ([\d.]+) N/m", done.stdout).group(1)) / 700, 1, delta=0.01)

    def test_a_hand_follows_its_path_and_stays_at_its_end(self):
        session = self.join()
        self.start_wall()
        session.wait(lambda: {"museum", "desk"} <= session.participants.keys(), 20)
        session.join("zoe", "desk")
        began = session.time
        path = np.linspace([0.01, 0, 0.05], [-0.02, 0.01, 0.06], 1000)
        states = session.drive("zoe", path)
        self.assertGreater(len(states), 20)
        self.assertLess(session.time - began, 3)
        time = (states["session_time_ns"] - states["session_time_ns"][0]) * 1e-9
        expected = path[np.minimum((time * 1000).astype(int), 999)]
        self.assertLess(np.linalg.norm(states["position"] - expected, axis=1).max(), 0.01)
        self.assertLess(np.linalg.norm(session.state("zoe")["position"] - path[-1]), 0.003)
        back = session.drive("zoe", path[::-1])
        self.assertLess(np.linalg.norm(back["position"][-1] - path[0]), 0.005)
        with self.assertRaisesRegex(ValueError, "user: found 'ann', expected a user that this participant has"):
            session.move("ann", path)
        with self.assertRaisesRegex(ValueError, "hrtc: found 'other', expected 'desk'"):
            session.join("bob", "other")

    def test_a_user_that_a_roster_entry_cannot_have_is_refused_and_the_others_stay(self):
        session, other = self.join(name="script"), self.join()
        for user in ("", "a*b", "x" * 64, "a\0b"):
            with self.assertRaisesRegex(ValueError, "users: expected names of 1..63 bytes"):
                session.join(user, "desk")
        with self.assertRaisesRegex(ValueError, "requested_hrtc: expected at most 63 bytes"):
            session.join("zoe", "x" * 64)
        users = [f"user-{i}" for i in range(64)]
        for user in users:
            with self.assertRaises(TimeoutError):  # there is no HRTC
                session.join(user, "desk", timeout=0)
        with self.assertRaisesRegex(ValueError, "users: expected at most 64; found user 'one-more'"):
            session.join("one-more", "desk")
        other.wait(lambda: "script" in other.participants and other.participants["script"]["users"] == users, 20)
        self.assertEqual(session.end_reason, "")

    def test_a_script_with_keys_sees_a_secured_session_and_one_without_sees_nobody(self):
        def keys(*arguments):
            subprocess.run([BIN / "tactus-keys", *arguments], cwd=self.folder, check=True, stdout=subprocess.DEVNULL)
        keys("init", "lab")
        for role, member, *users in (("host", "museum"), ("hrtc", "desk"), ("user", "script", "zoe"),
                                      ("observer", "watcher")):
            keys(f"add-{role}", "lab", member, *users)
        members = self.folder / "lab/members"
        self.start("host", "--config", "wall.yaml", "--name", "museum", "--keys", str(members / "museum"))
        self.start("hrtc", "--name", "desk", "--keys", str(members / "desk"))
        session = self.join(name="script", keys=members / "script")
        session.wait(lambda: {"museum", "desk"} <= session.participants.keys(), 30)
        session.join("zoe", "desk")
        self.assertGreater(len(session.drive("zoe", np.linspace([0, 0, 0.05], [0.01, 0, 0.05], 500))), 10)
        with self.assertRaisesRegex(tactus.WireError, "user 'bob': the keys of user 'script' permit only zoe"):
            session.join("bob", "desk")
        watcher = self.join(name="watcher", keys=members / "watcher")
        session.wait(lambda: any(name.startswith("watcher") for name in session.participants), 30)
        watcher.wait(lambda: "museum" in watcher.participants, 30)
        with self.assertRaisesRegex(tactus.WireError, "tactus_intent: the keys of observer 'watcher' do not permit"):
            watcher.join("zoe", "desk")
        self.assertEqual(watcher.end_reason, "")
        self.assertEqual(self.join().participants, {})
        with self.assertRaisesRegex(tactus.WireError, "expected the folder of a member"):
            self.join(keys=self.folder)
        with self.assertRaisesRegex(tactus.WireError, "keys: found no name"):
            self.join(keys="")

    def test_a_recording_has_the_rows_of_the_tables_of_the_recorder(self):
        session = self.join()
        self.start_wall()
        session.wait(lambda: {"museum", "desk"} <= session.figures.keys(), 20)
        recorder = self.start("record", "all.mcap")  # joins a running session, whose catalogue it gets at once
        (self.folder / "hold.yaml").write_text(SCENARIO)
        self.start("sim", "--scenario", "hold.yaml")
        session.wait(lambda: session.state("ann") is not None and session.state("ann")["in_contact"], 30)
        recorder.send_signal(signal.SIGINT)
        self.assertEqual(recorder.wait(10), 0)
        subprocess.run([BIN / "tactus-record", "all.mcap", "--to-csv", "csv"], cwd=self.folder, check=True,
                       stdout=subprocess.DEVNULL)
        recording = tactus.Recording(self.folder / "all.mcap")
        self.assertLess({"tactus_roster", "tactus_catalogue", "tactus_probe_state"}, recording.topics.keys())
        for topic, rows in dict(recording).items():
            name = topic.lstrip("/").replace("/", "_")  # of /scene/objects: scene_objects
            with open(self.folder / "csv" / f"{name}.csv", newline="") as file:
                table = list(csv.DictReader(file))
            self.assertEqual(len(rows), len(table))
            for column in table[0]:
                values, names = rows, column.split(".")
                for name in names:
                    values = values[:, int(name)] if name.isdigit() else values[name]
                if isinstance(values[0], str):
                    self.assertEqual(list(values), [row[column] for row in table], f"{topic} {column}")
                elif values.dtype != object:
                    expected = [{"true": 1, "false": 0}.get(row[column], row[column]) for row in table]
                    np.testing.assert_array_equal(values, np.array(expected, values.dtype), f"{topic} {column}")

    def test_an_operator_stops_and_resets_forces_and_ends_the_session(self):
        session = self.join()
        programs = self.start_wall()
        (self.folder / "hold.yaml").write_text(SCENARIO)
        self.start("sim", "--scenario", "hold.yaml")

        def force():
            state = session.state("ann")
            return 0 if state is None else np.linalg.norm(state["force"])
        session.wait(lambda: force() > 0.5, 30)
        self.assertEqual(session.stop_forces("a test"), ["desk", "museum"])
        session.wait(lambda: force() == 0, 2)
        self.assertEqual(session.reset_forces(), ["desk", "museum"])
        session.wait(lambda: force() > 0.5, 10)
        session.set_mode("large-scale ann")
        session.wait(lambda: "large-scale" in (self.folder / "hrtc.log").read_text(), 5)
        with self.assertRaisesRegex(ValueError, "text"):
            session.stop_forces("x" * 10000)
        session.end("a test")
        self.assertEqual([program.wait(20) for program in programs], [0, 0])
        self.assertIn("a test", session.end_reason)

    def test_an_object_that_one_of_two_hosts_withdraws_is_still_offered(self):
        session = self.join()
        self.start("host", "--config", "wall.yaml", "--name", "museum")

        def host():
            return session.objects["wall"]["host"] if "wall" in session.objects else None
        session.wait(lambda: host() == "museum", 20)
        annex = self.start("host", "--config", "wall.yaml", "--name", "annex")
        session.wait(lambda: host() == "annex", 20)
        annex.send_signal(signal.SIGINT)
        self.assertEqual(annex.wait(20), 0)
        session.wait(lambda: "annex" not in session.participants and host() == "museum", 20)

    def test_a_stop_waits_for_the_programs_that_are_found_after_the_first(self):
        session = self.join()
        time.sleep(1.6)  # 1.5 s count from the first program that is found, not from the join
        began = time.monotonic()
        self.start_wall()
        session.wait(lambda: session.participants, 30)
        self.assertIn("desk", session.stop_forces("a test", timeout=30))
        self.assertGreater(time.monotonic() - began, 1.5)

    def test_a_reset_while_later_stops_are_issued_is_refused(self):
        session, other = self.join(), self.join(name="other")
        self.start_wall()
        session.stop_forces("found all", timeout=30)
        ended = threading.Event()

        failures = []

        def stop():
            try:
                while not ended.is_set():
                    other.stop_forces("again", timeout=30)
            except Exception as failure:
                failures.append(failure)
        issuer = threading.Thread(target=stop)
        issuer.start()

        def refusal():
            try:
                session.reset_forces(timeout=30)
                return ""
            except RuntimeError as error:
                self.assertRegex(str(error), "stops that this reset did not name are still in force.*(desk|museum): ")
                return str(error)
        try:
            # The newest stop may have reached only the host yet.
            session.wait(lambda: "desk: " in refusal(), 30)
        finally:
            ended.set()
            issuer.join()
            self.assertEqual(failures, [])
        session.wait(lambda: not refusal(), 30)  # its roster may get the last stop later than that of the other

    def test_a_stop_without_an_hrtc_names_what_is_missing(self):
        session = self.join()
        with self.assertRaisesRegex(TimeoutError, "acknowledged by HRTCs: none; by hosts: none; not by: none"):
            session.stop_forces(timeout=0.2)

    def test_the_end_of_the_session_ends_a_wait(self):
        session = self.join()
        self.start_wall()
        session.wait(lambda: "desk" in session.participants, 20)
        subprocess.run([BIN / "tactus-control", "end", "--session", self.session, "--domain", str(self.domain)],
                       check=True, stdout=subprocess.DEVNULL)
        with self.assertRaisesRegex(RuntimeError, "the session has ended"):
            session.wait(lambda: False, 20)
        self.assertIn("the session has ended", session.end_reason)

    def test_what_does_not_happen_raises_a_timeout(self):
        session = self.join()
        with self.assertRaisesRegex(TimeoutError, "the condition did not hold within 0.1"):
            session.wait(lambda: False, 0.1)
        with self.assertRaises(TimeoutError):
            session.wait(lambda: False, float("nan"))
        with self.assertRaisesRegex(TimeoutError, "not served: zoe by nowhere"):
            session.join("zoe", "nowhere", timeout=0.1)
        self.assertIsNone(session.time)
        with self.assertRaisesRegex(KeyError, "mine"):
            session.wait(lambda: {}["mine"])

    def test_a_session_that_cannot_be_joined_raises_the_text_of_the_programs(self):
        for options, error in [({"session": "a/b"}, "session"), ({"domain": 1000}, "domain")]:
            with self.assertRaisesRegex(tactus.WireError, error):
                tactus.Session(**{"session": self.session, "domain": self.domain, **options})
        session = self.join()
        session.close()
        session.close()
        with self.assertRaisesRegex(RuntimeError, "this session was closed"):
            _ = session.participants

    def test_the_second_program_of_a_name_must_leave(self):
        self.start_wall()
        first = self.join(name="script")
        first.wait(lambda: first.time is not None, 20)
        second = self.join(name="script")
        with self.assertRaisesRegex(RuntimeError, "another program named 'script' is already in session"):
            second.wait(lambda: False, 20)
        self.assertEqual(first.end_reason, "")

    def test_a_script_that_ends_without_closing_leaves_the_session(self):
        session = self.join()
        script = (f"import tactus; s = tactus.Session('{self.session}', 'short', domain={self.domain})\n"
                  "s.wait(lambda: s.participants)")
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        session.wait(lambda: "short" not in session.participants, 0.4)


if __name__ == "__main__":
    unittest.main()
