"""The programs of examples/python run, and print what they announce."""

import json
import re
import subprocess
import sys
import unittest

from support import SOURCE, FolderTest


class ExamplesTest(FolderTest):
    def output_of(self, name, *arguments):
        done = subprocess.run([sys.executable, SOURCE / "examples/python" / name, *arguments], cwd=self.folder,
                              capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return done.stdout

    def test_build_model(self):
        self.assertIn("'exact': True", self.output_of("build_model.py"))

    def test_refine(self):
        contact, exact = re.search(r"(\d+) contact cycles, (\d+) of them", self.output_of("refine.py")).groups()
        self.assertGreater(int(contact), 10)
        self.assertGreater(int(exact), 0.9 * int(contact))

    def test_stiffness(self):
        stiffness = float(re.search(r"stiffness ([\d.]+) N/m", self.output_of("stiffness.py")).group(1))
        self.assertAlmostEqual(stiffness / 800, 1, delta=0.01)
        self.assertGreater(len((self.folder / "curve.csv").read_text().splitlines()), 1000)

    def test_the_cells_of_the_notebook(self):
        notebook = json.loads((SOURCE / "examples/python/tour.ipynb").read_text())
        cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
        (self.folder / "tour.py").write_text("\n\n".join(cells))
        output = self.output_of(self.folder / "tour.py")
        for link in ("P0", "P2", "P4"):
            local, remote = (float(re.search(rf"{link}, {where} device: (\d+) N/m", output).group(1))
                             for where in ("local", "remote"))
            self.assertAlmostEqual(local / 800, 1, delta=0.01)
            self.assertLessEqual(remote, 1.01 * local)
        self.assertRegex(output, "tap-wall P4 0.0")


if __name__ == "__main__":
    unittest.main()
