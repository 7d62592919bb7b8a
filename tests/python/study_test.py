"""Studies in virtual time."""

import csv
import subprocess
import unittest

import numpy as np

import tactus
from support import BIN, FolderTest

STUDY = """
name: small
profiles: [P0, P4]
scenarios: [tap-wall, hand-over]
seeds: 2
collaboration: false
stiffness: false
"""


class StudyTest(FolderTest):
    def study(self):
        path = self.folder / "small.yaml"
        path.write_text(STUDY)
        return tactus.Study(str(path))

    def test_the_table_is_that_of_the_program(self):
        result = self.study().run()
        subprocess.run([BIN / "tactus-study", self.folder / "small.yaml", "--out", self.folder / "out"], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with open(self.folder / "out/results.csv", newline="") as file:
            expected = list(csv.DictReader(file))
        self.assertEqual(len(result.table), len(expected))
        for row, line in zip(result.table, expected):
            values = list(line.values())
            self.assertIn(row["experiment"], values)
            self.assertIn(row["link"], values)
            self.assertIn(row["figure"], values)
            numbers = [float(value) for value in values
                       if value.strip("-").replace(".", "").replace("e-", "").isdigit()]
            if np.isfinite(row["mean"]):
                self.assertTrue(np.isclose(numbers, row["mean"], rtol=1e-4, atol=1e-9).any(), (row, line))

    def test_the_program_writes_the_tables_although_a_run_fails(self):
        out = self.folder / "out"
        process = subprocess.run([BIN / "tactus-study", "--scenarios", "tap-wall", "--only", "tap-wall", "--profiles",
                                  "P0:loss=100", "--seeds", "1", "--jobs", "1", "--out", out], capture_output=True,
                                 text=True)
        self.assertEqual(process.returncode, 1, process.stderr)
        self.assertIn("tap-wall over P0:loss=100, seed 1: the base mesh was not shown", process.stderr)
        with open(out / "results.csv", newline="") as file:
            self.assertEqual({row["link"] for row in csv.DictReader(file)}, {"P0"})

    def test_a_run_stays_in_the_log_although_its_traces_cannot_be_written(self):
        out = self.folder / "out"
        out.mkdir()
        (out / "traces").write_text("")  # a file instead of the folder
        process = subprocess.run([BIN / "tactus-study", "--scenarios", "tap-wall", "--only", "tap-wall", "--profiles",
                                  "P0", "--seeds", "1", "--jobs", "1", "--trace", "--out", out], capture_output=True,
                                 text=True)
        self.assertEqual(process.returncode, 1, process.stderr)
        self.assertIn("the traces of tap-wall over P0, seed 1, could not be written", process.stderr)
        with open(out / "results.csv", newline="") as file:
            self.assertEqual({row["link"] for row in csv.DictReader(file)}, {"P0"})

    def test_means_are_those_of_the_runs(self):
        result = self.study().run(jobs=1)
        for row in result.table:
            runs = result.runs
            of = runs[(runs["experiment"] == row["experiment"]) & (runs["link"] == row["link"]) &
                      (runs["figure"] == row["figure"])]
            self.assertEqual(sorted(of["seed"]), [1, 2])
            self.assertTrue(np.isnan(of["value"]).all() or np.isclose(np.nanmean(of["value"]), row["mean"]))

    def test_progress_reaches_the_number_of_runs_in_this_thread(self):
        reports = []
        self.study().run(progress=lambda done, all: reports.append((done, all)))
        self.assertEqual({all for _, all in reports}, {8})
        self.assertEqual(sorted(reports), reports)
        self.assertEqual(reports[-1][0], 8)

    def test_an_exception_of_progress_ends_the_study(self):
        def stop(done, all):
            raise KeyError("enough")

        with self.assertRaisesRegex(KeyError, "enough"):
            self.study().run(progress=stop)

    def test_a_trace_has_the_forces_of_a_run(self):
        study = self.study()
        self.assertEqual(study.experiments, {"tap-wall": ["P0", "P4"], "hand-over": ["P0", "P4"]})
        hands = study.trace("tap-wall", "P4", seed=2)
        self.assertEqual(len(hands), 1)
        felt, true = hands[0]["force"], hands[0]["true_force"]
        self.assertGreater(np.abs(true).max(), 0.5)
        self.assertLess(np.sqrt(((felt - true) ** 2).sum(axis=1).mean()), 0.1)
        np.testing.assert_array_equal(hands[0], study.trace("tap-wall", "P4", seed=2)[0])

    def test_errors_have_the_text_of_the_programs(self):
        for arguments, error, text in [
            ({"scenarios": ["dance"]}, tactus.ScenarioError, "dance"),
            ({"profiles": ["P99"]}, tactus.LinkError, "P99"),
            ({"seeds": 0}, ValueError, "seeds: found 0"),
        ]:
            with self.assertRaisesRegex(error, text):
                tactus.Study(**arguments)
        (self.folder / "wrong.yaml").write_text("name: s\nseeds: 0\n")
        with self.assertRaisesRegex(tactus.YamlError, "wrong.yaml:2:8: seeds: found '0', expected a number from 1 to"):
            tactus.Study(str(self.folder / "wrong.yaml"))
        with self.assertRaisesRegex(ValueError, "found experiment 'x', expected one of: tap-wall; hand-over"):
            self.study().trace("x")


if __name__ == "__main__":
    unittest.main()
