/** Charts beyond their lines: consistency, events, another robot, and a closer look. */

import { readFile } from 'node:fs/promises';
import type { Locator, Page } from '@playwright/test';
import { accessible, expect, legible, openPart, sideways, test } from './fixtures';

const CONSISTENCY = [
  /^NIS/,
  /^Innovation forwards/,
  /^Innovation to the left/,
  /^Innovation in yaw/,
];

const points = async (slider: Locator) => Number(await slider.getAttribute('aria-valuemax'));

/** Opens the history of a robot that has sent some seconds. */
async function opened(page: Page): Promise<void> {
  await page.goto('/');
  // On a phone the fleet is a list of cards.
  await page.locator('main a[href^="/robots/"]').first().click();
  await openPart(page, 'History');
  const slider = page.getByRole('slider', { name: /^Innovation in yaw/ });
  await expect.poll(() => points(slider), { timeout: 40_000 }).toBeGreaterThan(8);
}

/** Length of the stretch in the address, s. */
function length(page: Page): number {
  const query = new URL(page.url()).searchParams;
  return (Date.parse(query.get('to') ?? '') - Date.parse(query.get('from') ?? '')) / 1000;
}

/** Gives a chart a stretch of a known length. */
async function cut(page: Page): Promise<number> {
  const to = Date.now();
  const url = new URL(page.url());
  url.searchParams.set('from', new Date(to - 120_000).toISOString());
  url.searchParams.set('to', new Date(to).toISOString());
  await page.goto(url.href);
  return 120;
}

test.beforeEach(async ({ page }) => opened(page));

test('it says whether the model explains the data, with NIS and innovations over time', async ({
  page,
}) => {
  const verdict = page.getByText(/errors are \d+\.\d times as large as expected/);
  await expect(verdict).toBeVisible({ timeout: 40_000 });
  for (const name of CONSISTENCY) {
    const slider = page.getByRole('slider', { name });
    expect(await points(slider)).toBeGreaterThan(4);
    await slider.focus();
    await page.keyboard.press('Home');
    await expect(slider).toHaveAttribute('aria-valuetext', /^\d\d:\d\d:\d\d \S+: −?\d/);
    await page.keyboard.press('Escape');
  }
  const figure = page
    .getByRole('figure')
    .filter({ has: page.getByRole('heading', { name: /^NIS/ }) });
  await figure.getByRole('button', { name: 'Show as table: NIS' }).click();
  await expect(figure.getByRole('row').nth(1)).toContainText(/\d\.\d\d.*2\.\d\d.*3\.\d\d/);
  const download = page.waitForEvent('download');
  await page.getByRole('button', { name: 'Download CSV: Innovation in yaw' }).click();
  const [head, first] = (await readFile(await (await download).path(), 'utf8')).split('\r\n');
  expect(head).toMatch(/^time_utc,innovation_yaw_rad,/);
  expect(first).toMatch(/Z,-?[\d.e-]+,-[\d.e-]+,[\d.e-]+$/);
});

test('correlations stand among the evidence', async ({ page }) => {
  await openPart(page, 'Evidence');
  const region = page.getByRole('region', { name: 'Correlations' });
  await expect(region.getByRole('row')).toHaveCount(5);
  await expect(region.getByRole('cell').filter({ hasText: /[01]\.\d\d/ })).toHaveCount(16);
});

test('events are labelled by key and by click', async ({ page }) => {
  const slider = page.getByRole('slider', { name: /^LiDAR x/ });
  await slider.focus();
  await page.keyboard.press('Home');
  await page.keyboard.press('PageUp');
  await expect(slider).toHaveAttribute('aria-valuetext', /; \w/);
  const label = slider.locator('.label');
  await expect(label).toContainText(/\d\d:\d\d:\d\d/);
  const word = await label.locator('b').innerText();
  await page.keyboard.press('Escape');
  await expect(label).toHaveCount(0);
  // The pointer finds a mark, and its label stays after a click.
  const box = await slider.boundingBox();
  if (!box) throw new Error('the chart has no place on the page');
  let x = box.x + 60;
  while (x < box.x + box.width && (await label.count()) === 0) {
    x += 8;
    await page.mouse.move(x, box.y + 90);
  }
  await page.mouse.click(x, box.y + 90);
  await page.mouse.move(x, box.y - 40);
  await expect(label.locator('b')).toBeVisible();
  expect(word).not.toBe('');
});

test('charts zoom by wheel, keys and double click', async ({ page }) => {
  const before = await cut(page);
  const slider = page.getByRole('slider').first();
  await slider.click({ position: { x: 300, y: 150 } });
  await page.mouse.wheel(0, -200);
  await expect.poll(() => length(page)).toBeLessThan(before * 0.75);
  const closer = length(page);
  await slider.focus();
  await page.keyboard.press('-');
  await expect.poll(() => length(page)).toBeGreaterThan(closer * 1.9);
  await slider.dblclick({ position: { x: 300, y: 150 } });
  await expect(page).not.toHaveURL(/from=/);
  await slider.dblclick({ position: { x: 300, y: 150 } });
  await expect(page).toHaveURL(/from=/);
});

test('another robot and an earlier time stand beside it', async ({ page }) => {
  const own = decodeURIComponent(new URL(page.url()).pathname.split('/').at(-1) ?? '');
  const other = own === 'tugger_02' ? 'tugger_03' : 'tugger_02';
  const pick = page.getByRole('combobox', { name: 'Beside it' });
  await pick.selectOption('another robot');
  await page.getByRole('textbox', { name: 'Robot' }).fill(other);
  await page.getByRole('button', { name: 'Show', exact: true }).click();
  await expect(page).toHaveURL(new RegExp(`with=${other}`));
  const figure = page
    .getByRole('figure')
    .filter({ has: page.getByRole('heading', { name: /^LiDAR x/ }) });
  await expect(figure.getByText(new RegExp(`${other} [+−]?\\d`))).toBeVisible();
  await figure.getByRole('button', { name: /^Show as table/ }).click();
  await expect(figure.getByRole('columnheader', { name: `${other} mm` })).toBeVisible();
  await pick.selectOption('an hour before');
  await expect(page).toHaveURL(/with=-1h/);
  await expect(figure.getByRole('columnheader', { name: 'an hour before mm' })).toBeVisible();
});

for (const [colorScheme, checked] of [
  ['light', accessible],
  ['dark', legible],
] as const) {
  test(`the parts with charts are accessible on every screen, ${colorScheme}`, async ({ page }) => {
    test.setTimeout(120_000);
    await page.emulateMedia({ colorScheme, reducedMotion: 'reduce' });
    for (const part of ['History', 'Evidence'] as const) {
      await openPart(page, part);
      for (const width of [1440, 390, 320]) {
        await page.setViewportSize({ width, height: 844 });
        await checked(page);
        expect(await sideways(page), `${part} at ${width} px`).toBe(0);
      }
      await page.setViewportSize({ width: 1440, height: 900 });
    }
  });
}

test.describe('on a phone', () => {
  test.use({ viewport: { width: 390, height: 844 }, hasTouch: true });

  test('two fingers zoom, one moves along, and a tap names an event', async ({ page }) => {
    const before = await cut(page);
    const slider = page.getByRole('slider').first();
    await slider.scrollIntoViewIfNeeded();
    const box = await slider.boundingBox();
    if (!box) throw new Error('the chart has no place on the page');
    const y = box.y + 90;
    const screen = await page.context().newCDPSession(page);
    const touch = (type: 'touchStart' | 'touchMove' | 'touchEnd', xs: number[]) =>
      screen.send('Input.dispatchTouchEvent', {
        type,
        touchPoints: xs.map((x, id) => ({ x: box.x + x, y, id })),
      });
    await touch('touchStart', [150, 250]);
    for (const by of [10, 20, 30, 40, 50]) await touch('touchMove', [150 - by, 250 + by]);
    await touch('touchEnd', []);
    await expect.poll(() => length(page)).toBeLessThan(before * 0.7);
    const from = new URL(page.url()).searchParams.get('from') ?? '';
    const closer = length(page);
    await touch('touchStart', [150]);
    for (const by of [20, 40, 60, 80]) await touch('touchMove', [150 + by]);
    await touch('touchEnd', []);
    await expect.poll(() => new URL(page.url()).searchParams.get('from') ?? '').not.toBe(from);
    expect(length(page)).toBeCloseTo(closer, 1);
    expect((new URL(page.url()).searchParams.get('from') ?? '') < from).toBe(true);
    await accessible(page);
  });
});
