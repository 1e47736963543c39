"""The client before a served instance: MESHWAY_URL names it."""

import asyncio
import io
import os
import pathlib
import tempfile
import unittest
from unittest import mock
from urllib.parse import urlsplit

import numpy
from cutting import Cutting
from meshway_client import AsyncMeshway, JobCancelled, Meshway, MeshwayError, TimedOut, Unreachable, steps

URL = os.environ["MESHWAY_URL"]
SMALL = {"training": {"max_evaluations": 20}, "surface": {"resolution": 24}}


def sphere(n=400, seed=1):
    points = numpy.random.default_rng(seed).normal(size=(n, 3))
    return points / numpy.linalg.norm(points, axis=1, keepdims=True)


def text(points):
    return "\n".join(" ".join(map(repr, row.tolist())) for row in points).encode()


class Served(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.client = Meshway(URL)
        self.addCleanup(self.client.close)

    def path(self, name):
        return pathlib.Path(self.folder.name) / name

    def proxied(self, cuts, **given):
        at = urlsplit(URL)
        proxy = Cutting((at.hostname, at.port), cuts)
        self.addCleanup(proxy.close)
        client = Meshway(proxy.url, **given)
        self.addCleanup(client.close)
        return proxy, client

    def test_meshes_come_in_colours_and_jobs_with_a_priority_and_an_end(self):
        mesh = self.client.reconstruct(sphere(), preset="fast", settings=SMALL, priority=3, ttl="1h")
        shown = mesh.job.raw
        self.assertEqual((shown["priority"], shown["ttl"]), (3, "1h"))
        head = mesh.content("ply", colors="distance").split(b"end_header")[0]
        self.assertIn(b"property uchar red", head)
        self.assertNotIn(b"red", mesh.content("ply").split(b"end_header")[0])
        path = mesh.save(self.path("mesh.glb"), colors="distance")
        self.assertIn(b"COLOR_0", pathlib.Path(path).read_bytes())
        with self.assertRaises(MeshwayError) as refused:
            mesh.content("stl", colors="distance")
        self.assertEqual(refused.exception.code, "request_invalid")

    def test_an_array_becomes_a_mesh_as_file_arrays_and_trimesh(self):
        mesh = self.client.reconstruct(sphere(), preset="fast")
        self.assertIn(mesh.verdict, ("good", "doubtful", "poor"))
        for ending, start in {"ply": b"ply", "stl": b"Meshway", "glb": b"glTF"}.items():
            path = mesh.save(self.path(f"mesh.{ending}"))
            data = pathlib.Path(path).read_bytes()
            self.assertTrue(data.startswith(start), ending)
            self.assertEqual(data, mesh.content(ending))
        vertices, triangles = mesh.arrays()
        self.assertEqual(triangles.max() + 1, len(vertices))
        self.assertLess(abs(numpy.linalg.norm(vertices, axis=1) - 1).max(), 0.3)
        body = mesh.trimesh()
        self.assertTrue(body.is_watertight)
        self.assertAlmostEqual(body.volume, 4.19, delta=0.6)
        self.assertTrue(mesh.report()["mesh"]["closed"])
        self.assertEqual(sorted(os.listdir(self.folder.name)), ["mesh.glb", "mesh.ply", "mesh.stl"])
        with self.assertRaisesRegex(ValueError, "ends in ply"):
            mesh.save(self.path("mesh.doc"))

    def test_a_cloud_is_a_path_bytes_a_file_or_an_array(self):
        points = sphere(50)
        path = self.path("scan.xyz")
        path.write_bytes(text(points))
        with open(path, "rb") as file:
            given = [path, str(path), path.read_bytes(), io.BytesIO(path.read_bytes()), file]
            ids = {self.client.upload(cloud).id for cloud in given}
        self.assertEqual(len(ids), 1)
        self.assertEqual(self.client.upload(points).points, 50)
        self.assertEqual(self.client.upload(numpy.hstack([points, points]).astype("f4")).points, 50)
        self.assertEqual(self.client.upload(points.tolist()).points, 50)
        for wrong, error in ((7, TypeError), (io.StringIO("1 2 3"), TypeError), (points[:, :2], ValueError)):
            with self.assertRaises(error):
                self.client.upload(wrong)

    def test_a_problem_is_an_exception_with_its_code(self):
        with self.assertRaises(MeshwayError) as refused:
            self.client.submit(sphere(50), settings={"surface": {"resolutoin": 3}})
        self.assertEqual(refused.exception.status, 422)
        self.assertFalse(refused.exception.retryable)
        self.assertEqual(refused.exception.errors[0]["pointer"], "/settings/surface/resolutoin")
        with self.assertRaises(MeshwayError) as missing:
            self.client.job("job_" + "0" * 32)
        self.assertEqual((missing.exception.status, missing.exception.code), (404, "not_found"))
        with self.assertRaises(Unreachable) as nobody:
            Meshway("http://127.0.0.1:1", retries=1).job("x")
        self.assertTrue(nobody.exception.retryable)

    def test_a_wait_that_ends_too_early_says_so_and_a_cancelled_job_too(self):
        job = self.client.submit(sphere(3000), preset="fine")
        with self.assertRaises(TimedOut):
            self.client.wait(job, timeout=0.2)
        self.client.cancel(job)
        with self.assertRaises(JobCancelled) as cancelled:
            self.client.wait(job)
        self.assertEqual(cancelled.exception.job.id, job.id)
        self.client.delete(job)
        with self.assertRaises(MeshwayError) as gone:
            self.client.job(job)
        self.assertEqual(gone.exception.code, "gone")

    def test_jobs_of_all_pages_come_newest_first(self):
        label = {"suite": os.urandom(4).hex()}
        made = [self.client.submit(sphere(50), preset="fast", settings=SMALL, labels=label).id for _ in range(3)]
        found = self.client.jobs(label=f"suite:{label['suite']}", limit="2")
        self.assertEqual([job.id for job in found], made[::-1])
        for job in made:
            self.client.wait(job)

    def test_a_batch_is_made_followed_and_erased_whole(self):
        label = {"suite": os.urandom(4).hex()}
        clouds = [sphere(300, 1), sphere(300, 2)]
        batch = self.client.batch(clouds, preset="fast", settings=SMALL, labels=label)
        self.assertEqual(len(batch.jobs), 2)
        told = list(self.client.watch(batch))
        self.assertEqual(sum(event.last for event in told), 2)
        self.assertEqual({event.data["job_id"] for event in told}, set(batch.jobs))
        ended = self.client.wait_batch(batch)
        self.assertEqual((ended.progress, ended.counts["succeeded"]), (1, 2))
        self.assertTrue(self.client.mesh(ended.jobs[1]).content("ply").startswith(b"ply"))
        self.client.delete(batch)
        with self.assertRaises(MeshwayError) as gone:
            self.client.show_batch(batch)
        self.assertEqual(gone.exception.code, "gone")
        with self.assertRaises(MeshwayError) as refused:
            self.client.batch([sphere(300, 1)], source="label:all")
        self.assertEqual(refused.exception.code, "source_unknown")

    def test_a_batch_is_cancelled_with_asyncio(self):
        async def flow():
            async with AsyncMeshway(URL) as client:
                batch = await client.batch([sphere(300, 3), sphere(300, 4)], preset="fine")
                await client.cancel_batch(batch)
                ended = await client.wait_batch(batch, timeout=120)
                self.assertEqual(ended.counts["cancelled"], 2)
                await client.delete(ended)

        asyncio.run(flow())

    def test_events_are_each_told_once_over_cut_connections(self):
        job = self.client.submit(sphere(), preset="fast", settings=SMALL)
        self.client.wait(job)
        whole = list(self.client.watch(job))
        self.assertEqual([event.id for event in whole], list(range(1, len(whole) + 1)))
        self.assertEqual(whole[-1].kind, "job.succeeded")
        # Heads have some 300 bytes: all these cuts are within the events.
        proxy, client = self.proxied([700, 900, 1100, 500])
        self.assertEqual(list(client.watch(job)), whole)
        self.assertGreater(len(proxy.sent), 3)
        self.assertIn(b"last-event-id: 0\r\n", proxy.sent[0].lower())
        self.assertNotIn(b"last-event-id: 0\r\n", proxy.sent[-1].lower())
        self.assertEqual(list(client.watch(job, after=len(whole) - 2)), whole[-2:])

    def test_lost_answers_are_asked_for_again_and_make_one_job(self):
        label = {"suite": os.urandom(4).hex()}
        # The answers to the upload and to the submit are lost, one whole and one in half.
        proxy, client = self.proxied([0, 40, 30], key="mw_secret")
        job = client.submit(text(sphere(60)), preset="fast", settings=SMALL, labels=label)
        self.assertEqual([found.id for found in self.client.jobs(label=f"suite:{label['suite']}")], [job.id])
        self.assertGreaterEqual(len(proxy.sent), 4)
        for sent in proxy.sent:
            self.assertIn(b"authorization: bearer mw_secret\r\n", sent.lower())
        self.client.wait(job)
        impatient = self.proxied([0, 0], retries=0)[1]
        with self.assertRaises(Unreachable):
            impatient.job(job)

    def test_a_large_file_goes_on_where_a_connection_broke(self):
        data = text(sphere(3000))
        path = self.path("a person.xyz")
        path.write_bytes(data)
        proxy, client = self.proxied([2000, 700, 0, 400, 1100])
        with mock.patch.multiple(steps, LARGE=10_000, PART=20_000):
            cloud = client.upload(path)
        self.assertGreater(len(proxy.sent), 5)
        self.assertEqual(cloud.raw["bytes"], len(data))
        self.assertEqual(self.client.upload(data).id, cloud.id)
        self.assertNotIn(b"a person", b"".join(proxy.sent))
        with mock.patch.multiple(steps, LARGE=10, PART=20), self.assertRaises(MeshwayError) as refused:
            self.client.upload(b"1 2 3\n" * 20)
        self.assertEqual(refused.exception.code, "cloud_degenerate")

    def test_an_erasure_whose_answer_was_lost_is_one(self):
        cloud = self.client.upload(sphere(70, seed=9))
        self.proxied([0])[1].delete(cloud)
        with self.assertRaises(MeshwayError):
            self.client.submit(cloud)

    def test_the_async_twin_does_the_same(self):
        async def flow():
            path = self.path("scan.xyz")
            path.write_bytes(text(sphere()))
            at = urlsplit(URL)
            proxy = Cutting((at.hostname, at.port), [0, 700])
            async with AsyncMeshway(proxy.url) as client:
                mesh = await client.reconstruct(path, preset="fast", settings=SMALL, timeout=300)
                saved = await mesh.save(self.path("mesh.stl"))
                self.assertIn(b"COLOR_0", await mesh.content("glb", colors="distance"))
                vertices, triangles = await mesh.arrays()
                again = [event.id async for event in client.watch(mesh.job)]
                jobs = [job.id async for job in client.jobs(cloud_id=mesh.job.cloud_id)]
                await client.delete(mesh.job)
                with self.assertRaises(MeshwayError):
                    await client.mesh(mesh.job)
            proxy.close()
            return saved, len(vertices), len(triangles), again, jobs == [mesh.job.id]

        saved, vertices, triangles, again, alone = asyncio.run(flow())
        self.assertEqual(os.path.getsize(saved), 84 + 50 * triangles)
        self.assertGreater(vertices, 100)
        self.assertEqual(again, list(range(1, len(again) + 1)))
        self.assertTrue(alone)


if __name__ == "__main__":
    unittest.main()
