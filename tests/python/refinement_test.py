"""Local refinement, compared with brute force over the finest mesh."""

import threading
import unittest

import numpy as np

import tactus

RADIUS = 0.003


def nearest_on_triangles(point, triangles):
    """The distance of a point from each triangle, by projection onto the plane and the three edges."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.einsum("ij,ij->i", point - a, normal)
    foot = point - height[:, None] * normal
    inside = np.ones(len(triangles), bool)
    distance = np.full(len(triangles), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ij,ij->i", np.cross(end - start, foot - start), normal) >= 0
        edge = end - start
        share = np.clip(np.einsum("ij,ij->i", point - start, edge) / np.einsum("ij,ij->i", edge, edge), 0, 1)
        distance = np.minimum(distance, np.linalg.norm(point - start - share[:, None] * edge, axis=1))
    return np.where(inside, np.abs(height), distance)


class LocalRefinementTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.model = tactus.build(tactus.Mesh.generate("organ", faces=60_000))
        cls.finest = cls.model.vertices[cls.model.finest_faces].astype(float)

    def refined_at(self, position):
        refinement = tactus.LocalRefinement(self.model, RADIUS)
        for cycle in range(20):
            refinement.approach(position, 0.001 * cycle, True)
            refinement.refine(1 << 20)
        return refinement

    def test_contacts_are_those_of_the_finest_mesh(self):
        for vertex in (0, 1000, 20_000):
            centre = self.model.vertices[vertex].astype(float) * 1.02
            refinement = self.refined_at(centre)
            self.assertTrue(refinement.exact)
            contacts, first = refinement.find_contacts([centre])
            distance = nearest_on_triangles(centre, self.finest)
            self.assertEqual(first.tolist(), [0, len(contacts)])
            self.assertEqual(sorted(contacts["face"]), np.flatnonzero(distance <= RADIUS).tolist())
            self.assertTrue(contacts["finest"].all())
            np.testing.assert_allclose(np.linalg.norm(contacts["point"] - centre, axis=1), distance[contacts["face"]],
                                       atol=1e-9)

    def test_the_nearest_point_is_that_of_the_finest_mesh(self):
        centre = self.model.vertices[1000].astype(float) * 1.02
        found = self.refined_at(centre).nearest([centre, centre + 1], 2 * RADIUS)
        self.assertAlmostEqual(found["distance"][0], nearest_on_triangles(centre, self.finest).min(), delta=1e-9)
        self.assertTrue(np.isinf(found["distance"][1]))
        self.assertEqual(found["face"][1], 2**32 - 1)
        self.assertTrue(np.isnan(found["point"][1]).all())

    def test_a_sweep_ends_where_the_sphere_touches(self):
        centre = self.model.vertices[1000].astype(float)
        refinement = self.refined_at(centre * 1.02)
        start, end = centre * 1.2, centre
        hit = refinement.sweep([start, start], [end, start * 2])
        touching = start + hit["share"][0] * (end - start)
        self.assertAlmostEqual(nearest_on_triangles(touching, self.finest).min(), RADIUS, delta=1e-6)
        self.assertAlmostEqual(np.linalg.norm(hit["normal"][0]), 1, delta=1e-9)
        self.assertTrue(np.isinf(hit["share"][1]))

    def test_a_batch_gives_the_contacts_of_single_queries(self):
        centre = self.model.vertices[1000].astype(float) * 1.02
        refinement = self.refined_at(centre)
        centres = centre + np.random.default_rng(1).normal(scale=RADIUS, size=(50, 3))
        contacts, first = refinement.find_contacts(centres)
        for i in range(len(centres)):
            alone, _ = refinement.find_contacts(centres[i:i + 1])
            np.testing.assert_array_equal(contacts[first[i]:first[i + 1]], alone)

    def test_more_contacts_than_the_first_capacity_are_all_found(self):
        refinement = self.refined_at(self.model.vertices[1000].astype(float))
        contacts, _ = refinement.find_contacts([[0, 0, 0]], radius=1.0)
        triangles, faces = refinement.shown_triangles()
        self.assertGreater(len(contacts), 1024)
        self.assertEqual(sorted(contacts["face"]), faces.tolist())
        self.assertEqual(triangles.shape, (len(faces), 3, 3))
        self.assertLess(len(faces), 20_000)

    def test_a_followed_path_has_the_frames_of_single_calls(self):
        start = self.model.vertices[1000].astype(float)
        path = start * np.linspace(1.3, 1.0, 120)[:, None]
        rows = tactus.LocalRefinement(self.model, RADIUS).follow(path)
        single, touches = tactus.LocalRefinement(self.model, RADIUS), False
        for i, position in enumerate(path):
            single.approach(position, 0.001 * i, touches)
            self.assertEqual(single.refine(), rows["refined"][i])
            contacts, _ = single.find_contacts([position])
            touches = len(contacts) > 0
            self.assertEqual((len(contacts), single.exact), (rows["contacts"][i], rows["exact"][i]))
            if touches:
                depth = RADIUS - np.linalg.norm(contacts["point"] - position, axis=1).min()
                self.assertAlmostEqual(rows["depth"][i], depth, delta=1e-12)
        self.assertTrue(touches)
        self.assertEqual(rows["depth"][0], 0)

    def test_wrong_arguments_are_refused(self):
        refinement = tactus.LocalRefinement(self.model, RADIUS)
        refinement.approach([1, 1, 1], 0.5)
        for call, text in [
            (lambda: refinement.approach([1, 1, 1], 0.5), "time: found 0.5.* expected above 0.5"),
            (lambda: refinement.approach([1, 1, np.nan], 1), "position: found a number that is not finite"),
            (lambda: refinement.approach([1, 1, 1], 1e18), "time: found 1000.* expected -1e9 to 1e9 s"),
            (lambda: refinement.approach([1, 1, 1], np.inf), "time: found inf s, expected -1e9"),
            (lambda: refinement.approach([1, 1, 1], np.nan), "time: found nan s, expected -1e9"),
            (lambda: refinement.follow([[0, 0, 0], [1, 1, 1]], interval=np.inf), "interval: found inf s, expected"),
            (lambda: refinement.follow([[0, 0, 0], [1, 1, 1]], interval=np.nan), "interval: found nan s, expected"),
            (lambda: refinement.follow([[0, 0, 0]], interval=1e18), "time: found 1000.* expected -1e9 to 1e9 s"),
            (lambda: refinement.follow([[0, 0, np.inf]]), "path: found a number that is not finite"),
            (lambda: refinement.find_contacts([[0, 0, np.nan]]), "centres: found a number that is not finite"),
            (lambda: refinement.nearest([[0, 0, np.inf]], 1), "points: found a number that is not finite"),
            (lambda: refinement.nearest([[0, 0, 0]], np.nan), "max_distance: found nan, expected at least 0"),
            (lambda: refinement.sweep([[0, 0, np.nan]], [[0, 0, 0]]), "starts: found a number that is not finite"),
            (lambda: refinement.sweep([[0, 0, 0]], [[0, 0, np.inf]]), "ends: found a number that is not finite"),
            (lambda: tactus.LocalRefinement(self.model, RADIUS, load_ahead=np.inf), "load_ahead: found inf, expected"),
            (lambda: refinement.find_contacts([0, 0, 0]), r"centres: found shape \(3,\), expected \(n, 3\)"),
            (lambda: refinement.sweep([[0, 0, 0]], np.zeros((2, 3))), "ends: found 2 points, expected 1"),
            (lambda: tactus.LocalRefinement(self.model, -1.0), "radius: found -1"),
        ]:
            with self.assertRaisesRegex(ValueError, text):
                call()
        with self.assertRaisesRegex(RuntimeError, "the base mesh needs .* slots"):
            tactus.LocalRefinement(self.model, RADIUS, memory=1000)

    def test_the_model_exists_as_long_as_its_refinement(self):
        refinement = tactus.LocalRefinement(tactus.build(tactus.Mesh.generate("sphere", faces=2000)), RADIUS)
        rows = refinement.follow(np.linspace([0, 0, 0.1], [0, 0, 0.05], 100))
        self.assertGreater(rows["contacts"][-1], 0)

    def test_two_threads_may_query_one_refinement(self):
        centre = self.model.vertices[1000].astype(float) * 1.02
        refinement = self.refined_at(centre)
        expected, _ = refinement.find_contacts([centre])
        results = []
        threads = [threading.Thread(target=lambda: results.extend(
            refinement.find_contacts([centre] * 200)[0].size for _ in range(20))) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(set(results), {200 * len(expected)})


if __name__ == "__main__":
    unittest.main()
