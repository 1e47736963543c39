// A service that goes away and comes back, ten thousand jobs, and an hour of events.

import assert from 'node:assert/strict';
import { before, test } from 'node:test';
import { browse, drop, folder, open, sample, serve, shared, submit } from './support.mjs';

const t = shared();
let browser;

before(async () => {
  browser = await browse(t);
});

test('a service that is killed is missed, and found again', async () => {
  const [clouds, data] = [folder(t), folder(t)];
  const cloud = sample(clouds, 'sphere', 300);
  const killed = await serve(t, data);
  const { page } = await open(browser, killed.origin);
  await page.goto(`${killed.origin}/`);
  await page.getByText('Live', { exact: true }).waitFor();
  await killed.stop('SIGKILL');
  await page.getByRole('alert').getByText('The connection to the service is lost.').waitFor();
  await page.getByText('Not connected').waitFor();
  await serve(t, data, killed.origin.replace('http://', ''));
  await page.getByText('Live', { exact: true }).waitFor();
  await page.getByText('The connection to the service is lost.').waitFor({ state: 'hidden' });
  await submit(killed.origin, cloud, { preset: 'fast', labels: { file: 'later.ply' } });
  await page.getByRole('row', { name: /later\.ply.*Succeeded/ }).waitFor();
  await page.context().close();
});

test('behind a proxy that offers the service below a path, the page stays below it', async () => {
  const { origin } = await serve(t, folder(t), '127.0.0.1:0', ['--base-path', '/tools/mesh']);
  const { page, faults } = await open(browser, origin);
  page.on('request', (request) => {
    if (!/^(blob|data):/.test(request.url()) && !request.url().startsWith(`${origin}/tools/mesh/`)) faults.push(request.url());
  });
  await page.goto(`${origin}/tools/mesh/`);
  await page.getByText('Live', { exact: true }).waitFor();
  await drop(page, sample(folder(t), 'sphere', 300), 'ball.ply');
  await page.getByText('300 points').waitFor();
  await page.getByText('Fast', { exact: true }).click();
  await page.getByLabel('Training steps').fill('40');
  await page.getByLabel('Grid resolution').fill('32');
  await page.getByRole('button', { name: 'Start' }).click();
  await page.getByRole('application', { name: /[1-9][\d,]* triangles/ }).waitFor();
  assert.match(await page.getByRole('link', { name: 'Download STL' }).getAttribute('href'), /^\/tools\/mesh\/v1\/jobs\//);
  await page.getByText(`'${origin}/tools/mesh/v1/jobs'`).waitFor();
  assert.deepEqual(faults, []);
  await page.context().close();
});

/** Jobs that a service of many years might have, newest first. */
function many(total) {
  const statuses = ['succeeded', 'succeeded', 'failed', 'cancelled'];
  return Array.from({ length: total }, (_, i) => {
    const number = total - i;
    return {
      id: `job_${number.toString(16).padStart(32, '0')}`, cloud_id: `cld_${'0'.repeat(32)}`, status: statuses[number % 4], phase: null,
      preset: 'fast', settings: {}, labels: { file: `scan-${number}.ply` }, derived_from: null,
      created_at: new Date(Date.UTC(2026, 0, 1) + number * 60_000).toISOString(), started_at: null, finished_at: null, attempt: 1,
      progress: 1, eta_seconds: null, queue_position: null, error: null, links: {}, verdict: null, mesh: null,
    };
  });
}

/** A page on a service that has those jobs, whatever the real one has. */
async function scripted(jobs, events) {
  const { origin } = await serve(t, folder(t));
  const opened = await open(browser, origin);
  const asked = [];
  await opened.page.route('**/v1/jobs?*', (route) => {
    const query = new URL(route.request().url()).searchParams;
    const [start, limit] = [Number(query.get('cursor') ?? 0), Number(query.get('limit'))];
    asked.push(start);
    const next = start + limit < jobs.length ? String(start + limit) : null;
    return route.fulfill({ json: { items: jobs.slice(start, start + limit), next_cursor: next } });
  });
  if (events) {
    await opened.page.route('**/v1/events', (route) => route.fulfill({ contentType: 'text/event-stream', body: events }));
  }
  return { ...opened, origin, asked };
}

test('ten thousand jobs are scrolled through with few rows in the page', async () => {
  const { page, faults, origin, asked } = await scripted(many(10_000));
  await page.goto(`${origin}/`);
  await page.getByRole('link', { name: 'scan-10000.ply' }).waitFor();
  await page.evaluate(async () => {
    const frame = () => new Promise((resolve) => { requestAnimationFrame(resolve); });
    while (!document.querySelector('.count')?.textContent?.startsWith('10,000')) {
      scrollTo(0, document.documentElement.scrollHeight);
      await frame();
    }
    scrollTo(0, document.documentElement.scrollHeight);
  });
  await page.getByRole('link', { name: 'scan-1.ply', exact: true }).waitFor();
  const shown = await page.locator('.jobs tbody tr').count();
  assert.ok(shown < 60, `${shown} rows are in the page`);
  assert.equal(new Set(asked).size, 50);
  assert.equal(await page.locator('.jobs').getAttribute('aria-rowcount'), '10001');
  await page.evaluate(() => scrollTo(0, document.documentElement.scrollHeight / 2));
  await page.getByRole('link', { name: 'scan-5000.ply' }).waitFor();
  assert.deepEqual(faults, []);
  await page.context().close();
});

test('an hour of events leaves nothing behind', async () => {
  const jobs = many(50);
  jobs[0].status = 'running';
  const job = { job_id: jobs[0].id, time: '2026-01-01T00:00:00.000Z', attempt: 1 };
  // A stream that ended is not asked for again in the time of this test.
  const frames = ['retry: 3600000\n\n'];
  for (let i = 1; i <= 4 * 3600; i += 1) {
    const progress = { ...job, fraction: i / (4 * 3600), eta_seconds: 3600 - i / 4 };
    const metrics = { ...job, evaluation: i, iteration: i, loss: 1 / i, weight_norms: [1, 2, 3, 4, 5, 6] };
    frames.push(`id: ${2 * i}\nevent: job.progress\ndata: ${JSON.stringify(progress)}\n\n`);
    frames.push(`id: ${2 * i + 1}\nevent: training.metrics\ndata: ${JSON.stringify(metrics)}\n\n`);
  }
  const quiet = await scripted(jobs);
  const busy = await scripted(jobs, frames.join(''));
  const kept = async ({ page, origin }) => {
    await page.goto(`${origin}/`);
    await page.getByRole('link', { name: 'scan-50.ply' }).waitFor();
    return page;
  };
  const heap = async (page) => {
    const session = await page.context().newCDPSession(page);
    await session.send('HeapProfiler.collectGarbage');
    return (await session.send('Runtime.getHeapUsage')).usedSize;
  };
  const calm = await heap(await kept(quiet));
  const page = await kept(busy);
  await page.getByRole('row', { name: /scan-50\.ply.*100 %/ }).waitFor();
  const more = await heap(page) - calm;
  // The stream has eight megabytes of text.
  assert.ok(more < 2_000_000, `${more} bytes more than without events`);
  await quiet.page.context().close();
  await page.context().close();
});
