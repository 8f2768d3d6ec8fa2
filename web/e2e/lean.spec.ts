import type { Page, Request } from '@playwright/test';
import { expect, test } from './fixtures';

test.use({ command: 'serve', own: 'lean', as: 'admin' });

/** Time after which a page has read what it shows; nothing is due again yet. */
const OPENED_MS = 1_500;
/** A page says "Live" within this time. */
const LIVE_WITHIN_MS = 2_500;
/** An event may fall into the opening of a page; not into this many in a row. */
const OPENINGS = 4;
/** Paths that a page reads again and again while it is visible. */
const LIVE = /\/(top-view|stream|metrics)$/;
const ROUND_TRIPS = 15;
/** Listeners of what is not collected yet. */
const LISTENERS_MAX = 4;

/** Number of reads of each path of the API while `act` ran, the live ones apart. */
async function reads(page: Page, act: () => Promise<void>): Promise<Map<string, number>> {
  const found = new Map<string, number>();
  const count = (request: Request) => {
    const { pathname } = new URL(request.url());
    if (!pathname.startsWith('/api/') || LIVE.test(pathname)) return;
    found.set(pathname, (found.get(pathname) ?? 0) + 1);
  };
  page.on('request', count);
  await act();
  page.off('request', count);
  return found;
}

test.beforeAll(({ service }) => service.simulate());

const ROBOT = 'tugger_01';

test.beforeEach(async ({ page }) => {
  // Set up by the first of the tests; the others find it so.
  await page.request.put(`/api/v1/robots/${ROBOT}`, {
    headers: { 'if-none-match': '*' },
    data: { model: 'bicycle', wheelbase_m: 1.2 },
  });
  await page.goto('/');
  await expect(page.getByRole('rowheader')).toHaveCount(1, { timeout: 40_000 });
});

test('nothing is fetched twice when a page opens', async ({ page }) => {
  test.setTimeout(120_000);
  const robot = `/robots/${ROBOT}`;
  for (const path of [
    robot,
    `${robot}?show=history`,
    '/approvals',
    '/alerts',
    '/audit',
    '/settings',
    '/settings/users',
  ]) {
    // An event that falls into these moments rightly asks for a read again; a page that reads
    // twice by itself does so each time it opens.
    await expect(async () => {
      const found = await reads(page, async () => {
        await page.goto(path);
        await expect(page.getByText('Live', { exact: true })).toBeVisible();
        await page.waitForTimeout(OPENED_MS);
      });
      expect(found.size, path).toBeGreaterThan(2);
      const twice = [...found].filter(([, times]) => times > 1);
      expect(twice, path).toEqual([]);
    }).toPass({ intervals: [0], timeout: OPENINGS * (OPENED_MS + LIVE_WITHIN_MS) });
  }
});

test('manoeuvres are read every ten seconds, not with every estimate', async ({ page }) => {
  await page.getByRole('rowheader').getByRole('link').click();
  await expect(page.getByRole('heading', { name: 'Calibration in use' })).toBeVisible();
  const found = await reads(page, () => page.waitForTimeout(20_000));
  const times = [...found].find(([path]) => path.endsWith('/manoeuvres'))?.[1] ?? 0;
  expect(times).toBeGreaterThan(0);
  expect(times).toBeLessThanOrEqual(3);
});

test('listeners do not grow with navigation', async ({ page, context }) => {
  test.setTimeout(120_000);
  const cdp = await context.newCDPSession(page);
  await cdp.send('Performance.enable');
  const listeners = async (): Promise<number> => {
    await cdp.send('HeapProfiler.collectGarbage');
    const { metrics } = await cdp.send('Performance.getMetrics');
    return metrics.find(({ name }) => name === 'JSEventListeners')?.value ?? Number.NaN;
  };
  const trips = async (count: number) => {
    for (let i = 0; i < count; i++) {
      await page.getByRole('rowheader').getByRole('link').click();
      await expect(page.getByRole('heading', { name: 'Calibration in use' })).toBeVisible();
      await page.getByRole('link', { name: 'Fleet', exact: true }).first().click();
      await expect(page.getByRole('rowheader')).toHaveCount(1);
    }
  };
  await trips(3);
  const before = await listeners();
  await trips(ROUND_TRIPS);
  const after = await listeners();
  console.log(`listeners: ${before} before, ${after} after ${ROUND_TRIPS} round trips`);
  expect(after - before).toBeLessThanOrEqual(LISTENERS_MAX);
});
