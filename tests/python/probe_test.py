"""A probe over an emulated link."""

import threading
import time
import unittest

import numpy as np

import tactus

TOP = 0.01  # m, height of the wall's upper side
RADIUS = 0.003


def press(depth=0.02, samples=2000):
    """Positions of a hand that presses down onto the wall, `depth` beyond the first contact."""
    heights = np.linspace(TOP + RADIUS + 0.01, TOP + RADIUS - depth, samples)
    return np.column_stack([np.full(samples, 0.01), np.full(samples, 0.005), heights])


class ProbeTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.model = tactus.build(tactus.Mesh.generate("wall", faces=8000))

    def test_the_slope_of_force_over_displacement_is_the_stiffness(self):
        for link, stiffness, remote in (("P0", 300, False), ("P4", 800, False), ("P6", 2000, False), ("P2", 80, True)):
            with self.subTest(link=link, stiffness=stiffness, remote=remote):
                rows = tactus.Probe(self.model, RADIUS, link, stiffness=stiffness, remote_device=remote).run(press())
                touching = rows[rows["in_contact"] & rows["exact"]]
                self.assertGreater(len(touching), 500)
                displacement = np.linalg.norm(touching["proxy"] - touching["position"], axis=1)
                slope = np.polyfit(displacement, np.linalg.norm(touching["force"], axis=1), 1)[0]
                self.assertAlmostEqual(slope / stiffness, 1, delta=0.01)

    def test_the_proxy_stays_on_the_surface_and_the_force_is_along_its_normal(self):
        rows = tactus.Probe(self.model, RADIUS).run(press())
        touching = rows[rows["in_contact"] & rows["exact"]]
        np.testing.assert_allclose(touching["proxy"][:, 2], TOP + RADIUS, atol=1e-5)
        np.testing.assert_allclose(touching["normal"], np.tile([0, 0, 1], (len(touching), 1)), atol=1e-6)
        self.assertTrue((np.abs(touching["force"][:, :2]) < 1e-3).all())

    def test_equal_arguments_give_equal_rows_to_the_bit(self):
        first, second = (tactus.Probe(self.model, RADIUS, "P7", seed=5).run(press()) for _ in range(2))
        np.testing.assert_array_equal(first, second)
        other = tactus.Probe(self.model, RADIUS, "P7", seed=6).run(press())
        self.assertTrue((first["position"] != other["position"]).any())

    def test_there_is_a_row_for_each_millisecond_with_the_target_between_the_positions(self):
        path = press(samples=101)
        probe = tactus.Probe(self.model, RADIUS)
        began = probe.now
        rows = probe.run(path, interval=0.004)
        self.assertEqual(len(rows), 401)
        np.testing.assert_allclose(rows["target"][::4], path, atol=1e-12)
        np.testing.assert_allclose(rows["target"][2::4], (path[1:] + path[:-1]) / 2, atol=1e-12)
        np.testing.assert_allclose(rows["time"] - began, np.arange(1, 402) * 1e-3, atol=1e-9)
        self.assertEqual(len(probe.run(path[-1:])), 1)

    def test_the_hand_follows_its_path_without_contact(self):
        path = press(samples=500) + [0, 0, 0.05]
        rows = tactus.Probe(self.model, RADIUS).run(path)
        self.assertFalse(rows["in_contact"].any())
        self.assertLess(np.linalg.norm(rows["position"] - rows["target"], axis=1).max(), 0.005)

    def test_two_runs_continue_like_one(self):
        path = press()
        whole = tactus.Probe(self.model, RADIUS).run(path)
        probe = tactus.Probe(self.model, RADIUS)
        parts = np.concatenate([probe.run(path[:1000]), probe.run(path[1000:])])
        np.testing.assert_allclose(parts["position"], whole["position"], atol=1e-6)
        np.testing.assert_allclose(parts["time"], whole["time"])

    def test_a_slower_link_delivers_later(self):
        def delay_of_records(link):
            probe = tactus.Probe(self.model, RADIUS)
            before = probe.records_received
            probe.set_link(link)
            probe.run(press(samples=400)[:200])
            return probe.records_received - before

        self.assertGreater(delay_of_records("P0"), delay_of_records("P0:delay=2000"))

    def test_wrong_arguments_are_refused(self):
        for arguments, error, text in [
            ({"link": "P99"}, tactus.LinkError, "P99"),
            ({"link": "P0:delay=-1"}, tactus.LinkError, "delay"),
            ({"radius": 0}, ValueError, "radius: found 0.* expected above 0"),
            ({"stiffness": float("nan")}, ValueError, "stiffness: found nan"),
            ({"dynamic_friction": 0.5}, ValueError, "expected at most the static friction"),
        ]:
            with self.assertRaisesRegex(error, text):
                tactus.Probe(self.model, **arguments)
        probe = tactus.Probe(self.model)
        for path, interval, text in [
            (np.zeros((0, 3)), 0.001, "path: found no point"),
            ([[0, 0, np.inf]], 0.001, "path: found a number that is not finite"),
            ([[0, 0, 1]], 0, "interval: found 0"),
        ]:
            with self.assertRaisesRegex(ValueError, text):
                probe.run(path, interval)

    def test_other_threads_run_during_a_run(self):
        turns, done = [], threading.Event()

        def count():
            while not done.is_set():
                turns.append(time.monotonic())
                time.sleep(0.001)

        counter = threading.Thread(target=count)
        counter.start()
        probe = tactus.Probe(self.model)
        before = time.monotonic()
        probe.run(press(samples=20_000))
        after = time.monotonic()
        done.set()
        counter.join()
        self.assertGreater(len([turn for turn in turns if before < turn < after]), 5)


if __name__ == "__main__":
    unittest.main()
