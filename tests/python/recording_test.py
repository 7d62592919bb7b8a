"""Recordings as structured arrays. The files of these tests are made without code of Tactus."""

import unittest

import numpy as np

import tactus
from mcap import Cdr, mcap
from support import SOURCE, FolderTest

IDL = (SOURCE / "idl/tactus.idl").read_text()


def probe_state(number, big_endian=False):
    """A sample of ProbeState whose fields have different values."""
    return (Cdr(big_endian)
            .add("QIQ", 7, 1, 20)                            # user_id, probe, participant
            .add("QQq", 30, 31, -32)                         # stamp
            .add("IqI", number, 1000 + number, 50)           # sequence_number, session_time_ns, time_bound_us
            .add("ddddddd", 0.1, 0.2, 0.3, 0, 0, 0, 1)       # device
            .add("ddd", 1.5, 2.5, 3.5).add("ddd", 4, 5, 6)   # proxy, velocity
            .add("ddd", 0, 0, number / 2)                    # force
            .add("dQIfIf", 0.003, 9, 3, 0.25, 12, 1000)      # radius, object_id, status, error_bound, age, stiffness
            .sample())


def roster_entry(name, users):
    sample = (Cdr().add("Q", 5).add("QQq", 1, 2, 3).add("II", 16, 1).text(name).text("lab").text("")
              .add("I", len(users)))
    for user in users:
        sample.text(user)
    sample.add("I", 0)                                       # served_users
    sample.add("Q?", 99, False)                              # heartbeat, leaving
    sample.add("I", 1).add("QQIII", 11, 12, 13, 14, 15)      # stops
    return sample.add("Qqq?q", 5, 1234, 2**63 - 1, True, 0).sample()  # from reference to revoked_made_s


class RecordingTest(FolderTest):
    def recording(self, channels, messages, **options):
        path = self.folder / "test.mcap"
        path.write_bytes(mcap(channels, messages, **options))
        return tactus.Recording(path)

    def test_a_topic_of_fixed_size_has_a_row_for_each_sample(self):
        for big_endian in (False, True):
            recording = self.recording(
                {1: ("tactus_probe_state", "tactus::idl::ProbeState", "omgidl", IDL)},
                [(1, 10 + i, 1_700_000_000_000_000_000 + i, probe_state(i, big_endian)) for i in range(50)])
            rows = recording["tactus_probe_state"]
            self.assertEqual(rows.shape, (50,))
            np.testing.assert_array_equal(rows["log_time_ns"], 1_700_000_000_000_000_000 + np.arange(50))
            np.testing.assert_array_equal(rows["sequence"], 10 + np.arange(50))
            np.testing.assert_array_equal(rows["force"], np.column_stack([np.zeros((50, 2)), np.arange(50) / 2]))
            np.testing.assert_array_equal(rows["device"]["position"], np.tile([0.1, 0.2, 0.3], (50, 1)))
            np.testing.assert_array_equal(rows["stamp"]["time_ns"], -32)
            self.assertEqual(rows["error_bound"].dtype, np.float32)
            last = rows[-1]
            self.assertEqual((last["user_id"], last["participant"], last["radius"], last["object_id"], last["status"],
                              last["stiffness"], last["session_time_ns"]), (7, 20, 0.003, 9, 3, 1000, 1049))

    def test_texts_enumerators_and_sequences_are_objects(self):
        recording = self.recording({1: ("tactus_roster", "tactus::idl::RosterEntry", "omgidl", IDL)},
                                   [(1, 1, 5, roster_entry("hrtc-1", [])),
                                    (1, 2, 6, roster_entry("sim", ["ann", "zoë"]))])
        rows = recording["tactus_roster"]
        self.assertEqual(list(rows["name"]), ["hrtc-1", "sim"])
        self.assertEqual(list(rows["participant_role"]), ["kRoleHrtc", "kRoleHrtc"])
        self.assertEqual(list(rows["users"][1]["user"]), ["ann", "zoë"])
        self.assertEqual(len(rows["users"][0]), 0)
        self.assertEqual(rows["stops"][1][0].tolist(), (11, 12, 13, 14, 15))
        np.testing.assert_array_equal(rows["heartbeat"], 99)
        np.testing.assert_array_equal(rows["force_on"], True)
        np.testing.assert_array_equal(rows["session_time_ns"], 1234)

    def test_a_sequence_of_octets_is_an_array_of_octets(self):
        payload = bytes(range(200))
        sample = Cdr().add("IIIII", 1, 2, 3, 4, len(payload))
        sample.bytes += payload
        recording = self.recording({1: ("tactus_records", "tactus::idl::BulkChunk", "omgidl", IDL)},
                                   [(1, 1, 5, sample.sample())])
        found = recording["tactus_records"]["payload"][0]
        self.assertEqual((found.dtype, found.tobytes()), (np.uint8, payload))

    def test_a_sequence_of_arrays_has_the_alignment_of_their_numbers(self):
        idl = "typedef double Point[3]; struct Path { unsigned long id; sequence<Point> points; };"
        sample = Cdr().add("II", 7, 2).add("dddddd", *range(1, 7)).sample()
        recording = self.recording({1: ("path", "Path", "omgidl", idl)}, [(1, 1, 5, sample)])
        self.assertEqual(recording["path"]["points"][0].tolist(), [[1, 2, 3], [4, 5, 6]])

    def test_a_hostile_schema_or_sample_is_refused(self):
        for idl in ("typedef octet Z[0]; struct S { sequence<Z> z; };",
                    "struct E { }; struct S { E e[18446744073709551615]; };",
                    "struct S { octet x[4000000000]; };"):
            with self.assertRaisesRegex(tactus.SchemaError, "IDL, line 1: found"):
                self.recording({1: ("t", "S", "omgidl", idl)}, [(1, 1, 5, Cdr().add("I", 1).sample())])["t"]
        with self.assertRaisesRegex(tactus.SchemaError, "sample ends inside field z"):  # before it is allocated
            idl = "struct E { double e[65535]; }; struct S { sequence<E> z; };"
            sample = Cdr().add("I", 1_000_000).sample() + bytes(1_000_000)
            self.recording({1: ("t", "S", "omgidl", idl)}, [(1, 1, 5, sample)])["t"]

    def test_the_second_channel_of_a_topic_has_the_suffix_2(self):
        channel = ("tactus_probe_state", "tactus::idl::ProbeState", "omgidl", IDL)
        recording = self.recording({1: channel, 2: channel},
                                   [(1, 1, 5, probe_state(1)), (2, 1, 5, probe_state(2)), (2, 2, 5, probe_state(3))])
        self.assertEqual(recording.topics, {"tactus_probe_state": 1, "tactus_probe_state-2": 2})
        self.assertEqual(recording["tactus_probe_state-2"]["sequence_number"].tolist(), [2, 3])
        self.assertEqual(({name: len(rows) for name, rows in dict(recording).items()}), recording.topics)
        self.assertIn("tactus_probe_state", recording)
        self.assertEqual((len(recording), list(recording)), (2, recording.keys()))

    def test_the_order_of_the_messages_does_not_change_the_names_of_channels(self):
        channel = ("tactus_probe_state", "tactus::idl::ProbeState", "omgidl", IDL)
        recording = self.recording({1: channel, 2: channel},
                                   [(2, 1, 5, probe_state(2)), (1, 1, 5, probe_state(1)), (2, 2, 5, probe_state(3))])
        self.assertEqual(recording["tactus_probe_state"]["sequence_number"].tolist(), [1])
        self.assertEqual(recording["tactus_probe_state-2"]["sequence_number"].tolist(), [2, 3])

    def test_a_truncated_file_has_the_samples_before_its_end(self):
        whole = mcap({1: ("tactus_probe_state", "tactus::idl::ProbeState", "omgidl", IDL)},
                     [(1, i, 5, probe_state(i)) for i in range(3)], ended=False)
        path = self.folder / "killed.mcap"
        path.write_bytes(whole[:-10])
        recording = tactus.Recording(path)
        self.assertTrue(recording.truncated)
        self.assertEqual(len(recording["tactus_probe_state"]), 2)

    def test_objects_are_freed_with_their_array(self):
        import gc
        import weakref
        recording = self.recording({1: ("tactus_roster", "tactus::idl::RosterEntry", "omgidl", IDL)},
                                   [(1, 1, 5, roster_entry("sim", ["ann"]))])
        rows = recording["tactus_roster"]
        users = weakref.ref(rows["users"][0])
        self.assertIsNotNone(users())
        del rows
        gc.collect()
        self.assertIsNone(users())

    def test_wrong_files_are_refused_with_the_place(self):
        state = ("tactus_probe_state", "tactus::idl::ProbeState", "omgidl", IDL)
        with self.assertRaisesRegex(KeyError, "found no topic roster .* expected one of tactus_probe_state"):
            self.recording({1: state}, [(1, 1, 5, probe_state(1))])["roster"]
        with self.assertRaisesRegex(tactus.SchemaError, "sample ends inside field stiffness"):
            self.recording({1: state}, [(1, 1, 5, probe_state(1)[:-4])])["tactus_probe_state"]
        with self.assertRaisesRegex(tactus.SchemaError, "found another encoding"):
            self.recording({1: state}, [(1, 1, 5, b"\0\7\0\0" + probe_state(1)[4:])])["tactus_probe_state"]
        with self.assertRaisesRegex(tactus.SchemaError, "found schema encoding protobuf, expected omgidl"):
            self.recording({1: ("t", "T", "protobuf", "")}, [(1, 1, 5, b"")])
        with self.assertRaisesRegex(tactus.SchemaError, "IDL, line 1: found 'oops'"):
            self.recording({1: ("t", "T", "omgidl", "oops")}, [(1, 1, 5, b"")])
        with self.assertRaisesRegex(tactus.SchemaError, "sample ends inside field users"):
            damaged = bytearray(roster_entry("sim", ["ann"]))
            damaged[damaged.index(b"ann") - 8] = 0xff
            self.recording({1: ("t", "tactus::idl::RosterEntry", "omgidl", IDL)}, [(1, 1, 5, bytes(damaged))])["t"]
        (self.folder / "text.mcap").write_text("no recording")
        with self.assertRaisesRegex(tactus.McapError, "text.mcap: expected an MCAP file"):
            tactus.Recording(self.folder / "text.mcap")

    def test_an_id_is_that_of_the_name(self):
        self.assertNotEqual(tactus.id_of("ann"), tactus.id_of("zoe"))
        self.assertLess(tactus.id_of("ann"), 2**64)


if __name__ == "__main__":
    unittest.main()
