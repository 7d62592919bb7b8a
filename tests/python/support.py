"""Helpers of the tests of the Python package."""

import os
import pathlib
import tempfile
import unittest

SOURCE = pathlib.Path(os.environ["TACTUS_SOURCE"])
BIN = pathlib.Path(os.environ["TACTUS_BIN"])


class FolderTest(unittest.TestCase):
    """A test with an empty folder, which is deleted afterwards."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
