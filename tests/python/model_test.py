"""Meshes, models and builds."""

import subprocess
import threading
import time
import unittest

import numpy as np

import tactus
from support import BIN, FolderTest

TETRAHEDRON = ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def positions_of_faces(vertices, faces):
    """The faces as triples of positions, each turned to begin with the smallest corner, sorted."""
    turned = []
    for corners in vertices[faces].tolist():
        first = corners.index(min(corners))
        turned.append(corners[first:] + corners[:first])
    return sorted(turned)


class MeshTest(FolderTest):
    def test_arrays_return_as_they_were_given(self):
        mesh = tactus.Mesh(*TETRAHEDRON)
        np.testing.assert_array_equal(mesh.vertices, TETRAHEDRON[0])
        np.testing.assert_array_equal(mesh.faces, TETRAHEDRON[1])
        self.assertEqual((mesh.vertices.dtype, mesh.faces.dtype), (np.float32, np.uint32))

    def test_any_number_type_and_memory_order_is_accepted(self):
        vertices = np.asfortranarray(np.array(TETRAHEDRON[0], np.float64))
        faces = np.array(TETRAHEDRON[1], np.int8)[:, ::-1]
        mesh = tactus.Mesh(vertices, faces)
        np.testing.assert_array_equal(mesh.vertices, vertices)
        np.testing.assert_array_equal(mesh.faces, faces)

    def test_views_are_read_only_and_outlive_the_mesh(self):
        mesh = tactus.Mesh(*TETRAHEDRON)
        faces = mesh.faces
        self.assertIs(faces.base, mesh)
        with self.assertRaises(ValueError):
            faces[0, 0] = 1
        del mesh
        np.testing.assert_array_equal(faces, TETRAHEDRON[1])

    def test_wrong_arrays_are_refused_with_the_found_and_the_expected_value(self):
        vertices, faces = TETRAHEDRON
        for wrong, text in [
            (([[0, 0]], faces), r"vertices: found shape \(1, 2\), expected \(n, 3\)"),
            ((vertices, [0, 1, 2]), r"faces: found shape \(3,\), expected \(n, 3\)"),
            ((vertices, [[0.0, 1.0, 2.0]]), "faces: found numbers of type float64, expected integers"),
            ((vertices, [[0, 1, 4]]), "face 0: found vertex 4, expected below 4"),
            ((vertices, [[0, 1, 2], [0, -1, 2]]), "face 1: found vertex -1, expected below 4"),
        ]:
            with self.assertRaisesRegex(ValueError, text):
                tactus.Mesh(*wrong)

    def test_a_saved_mesh_loads_to_the_bit(self):
        organ = tactus.Mesh.generate("organ", faces=500, seed=3)
        organ.save(self.folder / "organ.ply")
        loaded = tactus.Mesh.load(str(self.folder / "organ.ply"))
        np.testing.assert_array_equal(loaded.vertices, organ.vertices)
        np.testing.assert_array_equal(loaded.faces, organ.faces)
        self.assertEqual(loaded.source, "organ.ply")

    def test_errors_have_the_text_of_the_programs(self):
        missing = str(self.folder / "missing.ply")
        with self.assertRaises(tactus.ModelError) as caught:
            tactus.Mesh.load(missing)
        program = subprocess.run([BIN / "tactus-mesh", "build", missing, "out.spm"], capture_output=True, text=True)
        self.assertEqual(program.stderr.strip(), f"tactus-mesh: {caught.exception}")
        with self.assertRaisesRegex(tactus.ModelError, "organ, terrain"):
            tactus.Mesh.generate("cow")


class ModelTest(FolderTest):
    @classmethod
    def setUpClass(cls):
        cls.mesh = tactus.Mesh.generate("organ", faces=20_000)
        cls.model = tactus.build(cls.mesh, size=0.2)

    def test_a_file_has_the_bytes_of_the_program(self):
        original = self.folder / "organ.ply"
        self.mesh.save(original)
        tactus.build(tactus.Mesh.load(original), size=0.2, cell_faces=300).save(self.folder / "python.spm")
        subprocess.run([BIN / "tactus-mesh", "build", original, self.folder / "program.spm", "--size", "0.2",
                        "--cell-faces", "300"], check=True, stdout=subprocess.DEVNULL)
        self.assertEqual((self.folder / "python.spm").read_bytes(), (self.folder / "program.spm").read_bytes())

    def test_an_opened_file_is_the_saved_model(self):
        path = self.folder / "organ.spm"
        self.model.save(path)
        opened = tactus.Model.open(path)
        self.assertEqual(opened.summary.digest, self.model.summary.digest)
        self.assertEqual((opened.source, opened.violations()), ("organ", []))
        for name in ("vertices", "base_faces", "finest_faces", "regions"):
            np.testing.assert_array_equal(getattr(opened, name), getattr(self.model, name))

    def test_a_damaged_file_is_refused_with_its_name(self):
        path = self.folder / "organ.spm"
        self.model.save(path)
        damaged = bytearray(path.read_bytes())
        damaged[len(damaged) // 2] ^= 1
        path.write_bytes(damaged)
        with self.assertRaisesRegex(tactus.ModelError, f"^{path}: .*checksum"):
            tactus.Model.open(path)

    def test_verify_finds_a_moved_vertex(self):
        self.assertTrue(self.model.verify(self.mesh)["exact"])
        vertices = np.array(self.mesh.vertices)
        vertices[7] += 1e-4
        report = self.model.verify(tactus.Mesh(vertices, self.mesh.faces))
        self.assertFalse(report["exact"])
        self.assertIn("faces of the original are missing", report["mismatches"][0])

    def test_arrays_have_the_sizes_of_the_summary(self):
        summary, model = self.model.summary, self.model
        self.assertEqual(model.vertices.shape, (summary.vertices, 3))
        self.assertEqual(model.finest_faces.shape, (summary.faces, 3))
        self.assertEqual(model.base_faces.shape, (summary.base_faces, 3))
        self.assertLess(model.base_faces.max(), summary.base_vertices)
        self.assertEqual(model.regions.shape, (summary.regions,))
        np.testing.assert_array_equal(summary.bounds, [model.vertices.min(axis=0), model.vertices.max(axis=0)])
        self.assertIs(model.regions.base, model)

    def test_the_finest_mesh_has_the_faces_of_the_original(self):
        self.assertEqual(positions_of_faces(self.model.vertices, self.model.finest_faces),
                         positions_of_faces(self.mesh.vertices, self.mesh.faces))

    def test_refinement_in_all_regions_is_the_finest_mesh_and_in_none_the_base_mesh(self):
        everything = self.model.refined_faces(np.arange(self.model.summary.regions))
        np.testing.assert_array_equal(everything, self.model.finest_faces)
        nothing = self.model.refined_faces([])
        self.assertEqual(sorted(nothing.tolist()), sorted(self.model.base_faces.tolist()))

    def test_refinement_near_a_point_has_every_finest_face_there(self):
        centre, radius = self.model.vertices[1234].astype(float), 0.004
        regions = self.model.regions_near(centre, radius)
        refined = {tuple(face) for face in self.model.refined_faces(regions).tolist()}
        self.assertLess(len(refined), self.model.summary.faces / 2)
        corners = self.model.vertices[self.model.finest_faces]
        near = np.linalg.norm(corners - centre, axis=2).min(axis=1) <= radius
        self.assertGreater(near.sum(), 3)
        for face in self.model.finest_faces[near].tolist():
            self.assertIn(tuple(face), refined)

    def test_a_sphere_around_the_model_intersects_all_regions(self):
        all_regions = self.model.regions_near([0, 0, 0], 1.0)
        np.testing.assert_array_equal(all_regions, np.arange(self.model.summary.regions))
        self.assertEqual(len(self.model.regions_near([1, 1, 1], 0.01)), 0)

    def test_wrong_arguments_are_refused(self):
        count = self.model.summary.regions
        with self.assertRaisesRegex(ValueError, f"found region {count}, expected below {count}"):
            self.model.refined_faces([count])
        with self.assertRaisesRegex(ValueError, r"centre: found shape \(2,\), expected \(3,\)"):
            self.model.regions_near([0, 0], 0.01)
        for option, value, text in [("size", -1, "size: found -1"),
                                    ("size", np.inf, "size: found inf, expected a finite"),
                                    ("pair_distance", np.inf, "pair_distance: found inf, expected a finite"),
                                    ("cell_faces", 2, "cell_faces: found 2, expected 8 to"),
                                    ("grid_bits", 30, "grid_bits: found 30, expected 0 or 4 to 20")]:
            with self.assertRaisesRegex(ValueError, text):
                tactus.build(self.mesh, **{option: value})
        with self.assertRaisesRegex(tactus.ModelError, "no surface: found 0 usable triangles"):
            tactus.build(tactus.Mesh([[0, 0, 0]], [[0, 0, 0]]))


class BuildTest(unittest.TestCase):
    def test_progress_reports_the_stages_in_order_up_to_one(self):
        reports = []
        tactus.build(tactus.Mesh.generate("sphere", faces=3000),
                     progress=lambda stage, done: reports.append((stage, done)))
        stages = list(dict.fromkeys(stage for stage, _ in reports))
        self.assertEqual((stages[0], stages[-1]), ("clean", "sum up"))
        self.assertIn("simplify", stages)
        self.assertEqual(reports[-1], ("sum up", 1.0))

    def test_an_exception_of_progress_ends_the_build(self):
        def stop(stage, done):
            if stage == "simplify":
                raise KeyError("enough")

        with self.assertRaisesRegex(KeyError, "enough"):
            tactus.build(tactus.Mesh.generate("sphere", faces=3000), progress=stop)

    def test_other_threads_run_during_a_build(self):
        mesh = tactus.Mesh.generate("organ", faces=60_000)
        turns = 0
        done = threading.Event()

        def count():
            nonlocal turns
            while not done.is_set():
                turns += 1
                time.sleep(0.001)

        counter = threading.Thread(target=count)
        counter.start()
        before = turns
        model = tactus.build(mesh, threads=1)
        after = turns
        done.set()
        counter.join()
        self.assertEqual(model.summary.faces, 60_000)
        self.assertGreater(after - before, 10)


if __name__ == "__main__":
    unittest.main()
