// Uploads a file over connections that are cut, goes on with it in another client, and gives one up.
// Arguments: address of the service, file, key.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import net from "node:net";
import { Upload } from "tus-js-client";

const [address, path, key] = process.argv.slice(2);
const bytes = await readFile(path);
const headers = { Authorization: `Bearer ${key}` };
const ask = (where, more = {}) => fetch(new URL(where, address), { headers, ...more });

// Cuts each connection after some bytes on the way in, until there were enough cuts. One lets through 25,000 bytes and a
// chunk of 65,536 at most, so that the file of 1.4 MB has room for twelve.
let cuts = 0;
const service = new URL(address);
const proxy = net.createServer((client) => {
  const there = net.connect(Number(service.port), service.hostname);
  let left = cuts < 12 ? 5_000 + Math.floor(Math.random() * 20_000) : Infinity;
  const end = () => (client.destroy(), there.destroy());
  client.on("data", (chunk) => {
    there.write(chunk);
    left -= chunk.length;
    if (left < 0) { cuts += 1; left = Infinity; end(); }
  });
  there.on("data", (chunk) => client.write(chunk));
  for (const socket of [client, there]) socket.on("close", end).on("error", end);
});
await new Promise((listening) => proxy.listen(0, "127.0.0.1", listening));
const through = `http://127.0.0.1:${proxy.address().port}`;

const upload = (options) => new Promise((done, fail) => {
  const one = new Upload(bytes, {
    endpoint: `${through}/v1/uploads`, headers, metadata: { filename: "cloud.ply" },
    retryDelays: Array(30).fill(20), onError: fail,
    onSuccess: ({ lastResponse }) => done({ one, lastResponse }), ...options,
  });
  // Addresses in answers are paths, which lead back through the proxy.
  one.start();
});

const { one, lastResponse } = await upload({ chunkSize: 150_000 });
assert.ok(cuts >= 12, `${cuts} cuts`);
const cloud = lastResponse.getHeader("Link").match(/<([^>]+)>/)[1];
const content = Buffer.from(await (await ask(`${cloud}/content`)).arrayBuffer());
assert.ok(content.equals(bytes), "other bytes came");
const state = await (await ask(new URL(one.url).pathname)).json();
assert.equal(`/v1/clouds/${state.cloud_id}`, cloud);

// A client that is gone, and another one that goes on where it was.
const half = await new Promise((done, fail) => {
  const first = new Upload(bytes, {
    endpoint: `${address}/v1/uploads`, headers, chunkSize: 50_000, onError: fail,
    onChunkComplete: (_, sent) => sent > 200_000 && first.abort().then(() => done(first)),
  });
  first.start();
});
const before = await (await ask(new URL(half.url).pathname)).json();
assert.ok(before.offset > 200_000 && before.offset < bytes.length, `${before.offset}`);
const second = await upload({ uploadUrl: half.url, uploadDataDuringCreation: false });
assert.equal(second.lastResponse.getHeader("Upload-Offset"), String(bytes.length));

// In the request that begins it, of a length that is not known at first, and one that is given up.
await upload({ endpoint: `${address}/v1/uploads`, uploadDataDuringCreation: true });
const { one: given } = await upload({ endpoint: `${address}/v1/uploads`, uploadLengthDeferred: true, chunkSize: 300_000 });
await given.abort(true);
assert.equal((await ask(new URL(given.url).pathname)).status, 410);
assert.equal((await ask(cloud)).status, 200);

proxy.close();
console.log(`tus: ${bytes.length} bytes over ${cuts} cut connections, gone on with, and given up`);
process.exit(0);
