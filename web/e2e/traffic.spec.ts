import { createServer, connect, type AddressInfo, type Server } from 'node:net';
import type { Browser } from '@playwright/test';
import { expect, test } from './fixtures';
import type { Service } from './binary';

test.use({ command: 'serve', own: 'traffic', as: 'admin' });

/** Most bytes a second that a page without the fleet may receive, compressed, with all headers. */
const RECEIVED_MAX_BPS = 5_000;
const FLEET_RECEIVED_MAX_BPS = 50_000;
/** A page has read what it shows after this time, and is then counted for so long. */
const OPENED_MS = 4_000;
const COUNTED_MS = 20_000;
const ROBOT = 'tugger_01';

/** Stands before the service and counts what it sends, as it goes over the wire. */
class Counter {
  bytes = 0;
  readonly #server: Server;

  constructor(service: Service) {
    const { hostname, port } = new URL(service.url);
    this.#server = createServer((client) => {
      const upstream = connect(Number(port), hostname);
      upstream.on('data', (data) => (this.bytes += data.length));
      for (const socket of [client, upstream]) {
        socket.on('error', () => undefined);
        socket.on('close', () => {
          client.destroy();
          upstream.destroy();
        });
      }
      client.pipe(upstream);
      upstream.pipe(client);
    });
  }

  async listen(): Promise<string> {
    await new Promise<void>((resolve) => this.#server.listen(0, '127.0.0.1', resolve));
    return `http://127.0.0.1:${(this.#server.address() as AddressInfo).port}`;
  }

  close(): void {
    this.#server.close();
  }
}

/** Traffic received by a page with its own counter once it is open, bytes/s. */
async function received(browser: Browser, service: Service, path: string): Promise<number> {
  const counter = new Counter(service);
  const context = await browser.newContext({
    baseURL: await counter.listen(),
    storageState: await service.signedIn('admin'),
  });
  const reader = await context.newPage();
  await reader.goto(path);
  await expect(reader.getByText('Live', { exact: true })).toBeVisible();
  await reader.waitForTimeout(OPENED_MS);
  const before = counter.bytes;
  await reader.waitForTimeout(COUNTED_MS);
  const per_s = ((counter.bytes - before) * 1000) / COUNTED_MS;
  await context.close();
  counter.close();
  return per_s;
}

test('no page receives what it does not show', async ({ browser, page, service }) => {
  test.setTimeout(150_000);
  service.simulate();
  const register = async () => {
    const given = await page.request.put(`/api/v1/robots/${ROBOT}`, {
      headers: { 'if-none-match': '*' },
      data: { model: 'bicycle', wheelbase_m: 1.2 },
    });
    return given.status();
  };
  expect(await register()).toBe(201);
  await page.goto(`/robots/${ROBOT}`);
  await expect(page.getByRole('heading', { name: 'Calibration in use' })).toBeVisible({
    timeout: 60_000,
  });
  await page.close();

  const pages = [
    ['/', FLEET_RECEIVED_MAX_BPS],
    [`/robots/${ROBOT}`, RECEIVED_MAX_BPS],
    [`/robots/${ROBOT}?show=history`, RECEIVED_MAX_BPS],
    ['/approvals', RECEIVED_MAX_BPS],
    ['/alerts', RECEIVED_MAX_BPS],
    ['/audit', RECEIVED_MAX_BPS],
    ['/settings', RECEIVED_MAX_BPS],
    ['/health', RECEIVED_MAX_BPS],
  ] as const;
  // All at once: each has connections and a counter of its own.
  const counted = pages.map(async ([path, most]) => {
    const per_s = await received(browser, service, path);
    return { path, most, per_s };
  });
  for (const { path, most, per_s } of await Promise.all(counted)) {
    console.log(`${path} receives ${(per_s / 1000).toFixed(2)} kB/s`);
    expect(per_s, path).toBeLessThanOrEqual(most);
  }
});

test('going from page to page changes what is sent, and nothing is missed', async ({ page }) => {
  const streams: string[] = [];
  page.on('request', (request) => {
    const { pathname, searchParams } = new URL(request.url());
    if (pathname.endsWith('/stream')) streams.push(searchParams.get('topics') ?? '');
  });
  await page.goto('/');
  await expect(page.getByText('Live', { exact: true })).toBeVisible();
  await page.getByRole('rowheader').getByRole('link').first().click();
  await expect(page.getByRole('heading', { name: 'Calibration in use' })).toBeVisible({
    timeout: 40_000,
  });
  await page.getByRole('link', { name: 'Alerts' }).first().click();
  await expect(page.getByRole('heading', { name: 'Alerts' })).toBeVisible();
  const base = 'alerts,approvals,deployments';
  await expect.poll(() => streams).toEqual([`fleet,${base}`, `robot:${ROBOT},${base}`, base]);
  await expect(page.getByText('Live', { exact: true })).toBeVisible();
});
