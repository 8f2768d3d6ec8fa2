/** The page that `calibrate --report` writes: a file, without a service. */

import { execFile } from 'node:child_process';
import { mkdtemp, rm } from 'node:fs/promises';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';
import { promisify } from 'node:util';
import { expect, test } from '@playwright/test';
import { binary } from './binary';
import { accessible, sideways } from './fixtures';

let folder: string;
let address: string;

test.beforeAll(async () => {
  folder = await mkdtemp(join(tmpdir(), 'fleetcal-report-'));
  const recording = join(folder, 'tugger.mcap');
  const page = join(folder, 'tugger.html');
  const run = promisify(execFile);
  await run(binary(), ['simulate', '--record', recording, '--duration', '30']);
  await run(binary(), ['calibrate', recording, '--wheelbase', '1.2', '--report', page]);
  address = pathToFileURL(page).href;
});

test.afterAll(async () => {
  await rm(folder, { recursive: true });
});

for (const colorScheme of ['light', 'dark'] as const) {
  test(`the report is accessible, wide and on a phone, ${colorScheme}`, async ({ page }) => {
    const requests: string[] = [];
    page.on('request', (request) => requests.push(request.url()));
    await page.emulateMedia({ colorScheme });
    await page.goto(address);
    await accessible(page);
    const back = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
    expect(back).toBe(colorScheme === 'light' ? 'rgb(245, 247, 248)' : 'rgb(14, 18, 21)');
    for (const width of [390, 320]) {
      await page.setViewportSize({ width, height: 640 });
      await accessible(page);
      expect(await sideways(page), `${width} px`).toBe(0);
      // Nor do its figures, whose letters stay readable.
      for (const figure of await page.getByRole('figure').locator('.scroll').first().all()) {
        expect(await figure.evaluate((one) => one.scrollWidth - one.clientWidth)).toBe(0);
      }
    }
    expect(requests).toEqual([address]);
  });
}

test('the report answers, and has the numbers behind each figure by keyboard', async ({ page }) => {
  await page.goto(address);
  await expect(page.getByText(/^The model explains the data/)).toBeVisible();
  for (const heading of ['Parameters', 'Events', 'Correlations', 'Recording']) {
    await expect(page.getByRole('heading', { name: heading, exact: true })).toBeVisible();
  }
  const numbers = page.getByText('Numbers of Steering offset');
  await numbers.focus();
  await page.keyboard.press('Enter');
  const table = page.getByRole('region', { name: 'Numbers of Steering offset' });
  await expect(table.getByRole('row').nth(1)).toContainText(/\d/);
});
