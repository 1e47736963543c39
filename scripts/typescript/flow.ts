// A whole flow with the client that scripts/typescript.sh generates: flow.js ADDRESS CLOUD.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import createClient from "openapi-fetch";
import type { components, paths } from "./meshway.js";

type Job = components["schemas"]["Job"];
type MeshFormat = components["schemas"]["MeshFormat"];

const [address, path] = process.argv.slice(2);
assert(address && path, "flow.js ADDRESS CLOUD");
const client = createClient<paths>({ baseUrl: address });
const bytes = await readFile(path);
const file = new Blob([bytes], { type: "application/octet-stream" });

/** Sends a file as it is: the client would write it as JSON. */
const asItIs = {
  headers: { "Content-Type": "application/octet-stream" },
  bodySerializer: <T>(body: T) => body,
};

/** What was answered, where it is not a problem. */
function given<T>(answer: { data?: T; error?: unknown; response: Response }): T {
  assert(answer.data !== undefined, `${answer.response.status}: ${JSON.stringify(answer.error)}`);
  return answer.data;
}

// Clouds: as a raw file, and the same bytes again.
const cloud = given(await client.POST("/v1/clouds", { body: file, ...asItIs }));
assert.equal(cloud.points, 500);
assert.equal(given(await client.POST("/v1/clouds", { body: file, ...asItIs })).id, cloud.id);
const kept = await client.GET("/v1/clouds/{id}/content", {
  params: { path: { id: cloud.id } },
  parseAs: "blob",
});
assert.deepEqual(Buffer.from(await given(kept).arrayBuffer()), bytes);

// Jobs: of that cloud, as a form with the file, and as the raw file alone.
const settings = { training: { max_evaluations: 20 }, surface: { resolution: 24 } };
const wait = { header: { Prefer: "wait=60" } };
const asked = { cloud_id: cloud.id, preset: "fast", settings, labels: { patient: "p7" } } as const;
const first = given(await client.POST("/v1/jobs", { params: wait, body: asked }));
const second = given(
  await client.POST("/v1/jobs", {
    params: wait,
    body: { file, job: { preset: "fast", settings } },
    bodySerializer: (body) => {
      assert("file" in body);
      const form = new FormData();
      form.set("file", body.file, "sphere.ply");
      form.set("job", JSON.stringify(body.job));
      return form;
    },
  }),
);
const dry = await client.POST("/v1/jobs", {
  params: { query: { dry_run: true, preset: "fast" } },
  body: file,
  ...asItIs,
});
const estimate = given(dry);
assert("dry_run" in estimate && estimate.estimate.memory_bytes > 0);

/** The job among what may be answered. */
function job(answer: typeof first): Job {
  assert("status" in answer, "no job was answered");
  return answer;
}
for (const { status, mesh } of [job(first), job(second)]) {
  assert.equal(status, "succeeded");
  assert(mesh && mesh.closed && mesh.triangles > 100);
}
const id = job(first).id;
const of = { params: { path: { id } } };
const listed = given(await client.GET("/v1/jobs", { params: { query: { label: "patient:p7" } } }));
assert.deepEqual(
  listed.items.map((item) => item.id),
  [id],
);

// Events: as a stream, and as pages.
const stream = await client.GET("/v1/jobs/{id}/events", { ...of, parseAs: "text" });
const names = [...String(given(stream)).matchAll(/^event: (.*)$/gm)].map((found) => found[1]);
assert.equal(names[0], "job.queued");
assert.equal(names.at(-1), "job.succeeded");
const page = await client.GET("/v1/jobs/{id}/events", { ...of, headers: { Accept: "application/json" } });
const events = given(page) as components["schemas"]["EventPage"];
assert.deepEqual(
  events.items.map((event) => event.event),
  names,
);

// The series, the report, the field.
const query = { fields: ["loss", "validation_loss"] as ("loss" | "validation_loss")[] };
const metrics = given(await client.GET("/v1/jobs/{id}/metrics", { params: { path: { id }, query } }));
assert(typeof metrics === "object" && "evaluation" in metrics.series && metrics.series.evaluation.length > 0);
const report = given(await client.GET("/v1/jobs/{id}/report", of));
assert.equal(report.mesh?.closed, true);
const field = await client.POST("/v1/jobs/{id}/field", { ...of, body: { points: [[0, 0, 0]] } });
assert.equal(given(field).values.length, 1);

// All meshes but the DICOM file, which a cloud without a frame has not.
type Plain = Exclude<MeshFormat, "dcm">;
const begins: Record<Plain, RegExp> = {
  ply: /^ply\n/,
  obj: /^(#|v )/,
  stl: /^Meshway/,
  off: /^OFF/,
  glb: /^glTF/,
  "3mf": /^PK/,
  vtp: /^<\?xml/,
};
for (const format of Object.keys(begins) as Plain[]) {
  const mesh = await client.GET("/v1/jobs/{id}/mesh.{format}", {
    params: { path: { id, format } },
    parseAs: "blob",
  });
  assert.match(await given(mesh).slice(0, 16).text(), begins[format]);
}

// Problems are typed, and tell what is wrong with what.
const wrong = await client.POST("/v1/jobs", {
  body: { cloud_id: cloud.id, settings: { network: { width: 0 } } },
});
assert.equal(wrong.error?.code, "settings_invalid");
assert.equal(wrong.error?.errors[0]?.pointer, "/settings/network/width");

for (const ended of [job(first), job(second)]) {
  const erased = await client.DELETE("/v1/jobs/{id}", { params: { path: { id: ended.id } } });
  assert.equal(erased.response.status, 204);
}
assert.equal((await client.GET("/v1/jobs/{id}", of)).error?.code, "gone");
const left = await client.DELETE("/v1/clouds/{id}", { params: { path: { id: cloud.id } } });
assert.equal(left.response.status, 204);
console.log("the TypeScript client: uploads, jobs, events, series, field, meshes, problems, erasure");
