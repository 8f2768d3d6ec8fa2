import { DEMO_ROBOTS as ROBOTS } from './decisions';
import type { Page } from '@playwright/test';
import { accessible, expect, sideways, test } from './fixtures';

/** A simulated robot is calibrated this long after its start at the latest. */
const CALIBRATED_WITHIN_MS = 90_000;

/** The robots where there is no room for a table. */
const cards = (page: Page) =>
  page.getByRole('listitem').filter({ has: page.getByRole('button', { name: /^Numbers of / }) });

test('the fleet has its six robots, and each is calibrated in time', async ({ page }) => {
  test.setTimeout(CALIBRATED_WITHIN_MS + 30_000);
  await page.goto('/');
  const rows = page.getByRole('row').filter({ has: page.getByRole('rowheader') });
  await expect(rows).toHaveCount(ROBOTS);
  for (const row of await rows.all()) {
    // Of the four values the one that is farthest off, as a number beside its bar.
    await expect(row.getByText(/^tolerances, (beyond|within) tolerance, \S+/)).toHaveCount(1, {
      timeout: CALIBRATED_WITHIN_MS,
    });
    await expect(row.locator('.number')).toHaveText(/^\d+(\.\d)?$/);
    // What is as usual is not said.
    await expect(row.getByText(/Online|converged|Silent/)).toHaveCount(0);
  }
  await expect(page.getByText('Live', { exact: true })).toBeVisible();
});

test('the numbers of a robot open beside the list, by keyboard, and stand in the address', async ({
  page,
}) => {
  test.setTimeout(CALIBRATED_WITHIN_MS + 30_000);
  await page.goto('/');
  const buttons = page.getByRole('button', { name: /^Numbers of / });
  await expect(buttons).toHaveCount(ROBOTS);
  await buttons.first().focus();
  await page.keyboard.press('Enter');
  const id = (await buttons.first().getAttribute('data-peek')) ?? '';
  const panel = page.getByRole('complementary', { name: id });
  const rows = panel.getByRole('row').filter({ has: page.getByRole('rowheader') });
  await expect(rows).toHaveCount(4);
  for (const row of await rows.all()) {
    await expect(row.getByText(/^[+\u2212]?\d+\.\d+ off$/)).toBeVisible({
      timeout: CALIBRATED_WITHIN_MS,
    });
    await expect(row.getByText(/^± \d+\.\d+$/)).toBeVisible();
  }
  await expect(panel.getByText('Online')).toBeVisible();
  await accessible(page);
  expect(new URL(page.url()).searchParams.get('robot')).toBe(id);
  // The drawings below make room for it, and none of them stands alone.
  const drawings = page.getByRole('listitem').filter({ hasText: /beyond tolerance|not known yet/ });
  const lefts = await drawings.evaluateAll((all) =>
    all.map((one) => one.getBoundingClientRect().left),
  );
  expect(new Set(lefts.slice(0, 2)).size).toBe(2);
  expect(lefts.slice(2)).toEqual(lefts.slice(0, 2));

  // An arrow goes on to another robot, and Escape back to where one was, wherever rows have moved.
  const order = await buttons.evaluateAll((all) => all.map((one) => one.getAttribute('data-peek')));
  await page.keyboard.press(order.at(-1) === id ? 'ArrowUp' : 'ArrowDown');
  await expect(panel).toHaveCount(0);
  const other = (await page.getByRole('complementary').getByRole('heading').innerText()).trim();
  await page.keyboard.press('Escape');
  await expect(page.getByRole('complementary')).toHaveCount(0);
  await expect(page.getByRole('button', { name: `Numbers of ${other}` })).toBeFocused();
  await page.goto(`/?robot=${id}`);
  await expect(panel).toBeVisible();
});

test('on a phone the numbers open by touch and close again', async ({ browser, service }) => {
  const context = await browser.newContext({
    baseURL: service.url,
    storageState: await service.signedIn('viewer'),
    viewport: { width: 390, height: 844 },
    hasTouch: true,
  });
  const page = await context.newPage();
  await page.goto('/');
  const any = page.getByRole('button', { name: /^Numbers of / }).first();
  // Cards change places while robots learn: this one is named.
  const id = (await any.getAttribute('data-peek')) ?? '';
  const button = page.getByRole('button', { name: `Numbers of ${id}` });
  expect((await button.boundingBox())?.height).toBeGreaterThanOrEqual(44);
  await button.tap();
  const panel = page.getByRole('complementary');
  await expect(panel.getByRole('heading')).toBeFocused();
  await accessible(page);
  await panel.getByRole('button', { name: 'Close' }).tap();
  await expect(panel).toHaveCount(0);
  await expect(button).toBeFocused();
  await context.close();
});

test('bars and lines share a scale, and their headings name it', async ({ page }) => {
  test.setTimeout(CALIBRATED_WITHIN_MS + 30_000);
  await page.goto('/');
  await expect(page.getByRole('columnheader', { name: 'Deviation, in tolerances' })).toBeVisible();
  // A demo is young: no robot has a week.
  await expect(page.getByRole('columnheader', { name: 'Last 3 h' })).toBeVisible();
  const lines = page.getByRole('row').getByRole('img');
  await expect(lines.nth(1)).toHaveAttribute('aria-label', /^Last 3 h: at most /, {
    timeout: CALIBRATED_WITHIN_MS,
  });
  const limits = await page
    .locator('tbody .week path.limit')
    .evaluateAll((paths) => paths.map((path) => path.getAttribute('d')));
  expect(new Set(limits).size).toBe(1);
});

test('the page moves without being asked', async ({ page }) => {
  await page.goto('/');
  await page
    .getByRole('button', { name: /^Numbers of / })
    .first()
    .click();
  const panel = page.getByRole('complementary');
  const before = await panel.innerText();
  await expect.poll(() => panel.innerText(), { timeout: 20_000 }).not.toBe(before);
});

test('the worst come first: what waits for a person stands before who only learns', async ({
  page,
}) => {
  test.setTimeout(CALIBRATED_WITHIN_MS + 30_000);
  await page.goto('/');
  const states = page.locator('tbody .state');
  const waiting = page.getByRole('row').filter({ hasText: 'Awaiting approval' });
  await expect(waiting.first()).toBeVisible({ timeout: CALIBRATED_WITHIN_MS });
  const words = (await states.allInnerTexts()).map((word) => word.trim());
  // Nothing has been applied yet: whoever is off was never calibrated, and has not drifted.
  const order = ['Awaiting approval', 'Needs calibration', 'Calibrating', 'Calibrated'];
  const places = words.map((word) => order.indexOf(word));
  expect(places).not.toContain(-1);
  expect(places).toEqual(places.toSorted((a, b) => a - b));
  const count = page.getByRole('navigation', { name: 'Show robots by state' });
  await expect(count.getByRole('link', { name: /^Awaiting approval/ })).toContainText(/\d/);
  // What waits for a decision is one click away.
  await expect(page.getByRole('link', { name: /^Awaiting approval of/ }).first()).toBeVisible({
    timeout: CALIBRATED_WITHIN_MS,
  });
});

test('a filter stands in the address and works from it', async ({ page }) => {
  await page.goto('/');
  const rows = page.getByRole('row').filter({ has: page.getByRole('rowheader') });
  await expect(rows).toHaveCount(ROBOTS);
  const name = (await rows.last().getByRole('link').first().innerText()).trim();
  await page.getByRole('searchbox').fill(name);
  await expect(rows).toHaveCount(1);
  expect(new URL(page.url()).searchParams.get('q')).toBe(name);
  await page.reload();
  await expect(rows).toHaveCount(1);
  await page.goto('/?state=estimator_failed');
  await expect(page.getByText('No robots match.')).toBeVisible();
  await page.getByRole('link', { name: /^Show all/ }).click();
  await expect(rows).toHaveCount(ROBOTS);
});

for (const colorScheme of ['light', 'dark'] as const) {
  test(`the fleet is accessible, ${colorScheme}`, async ({ page }) => {
    await page.emulateMedia({ colorScheme });
    await page.goto('/');
    await expect(page.getByRole('rowheader')).toHaveCount(ROBOTS);
    await accessible(page);
    await page.setViewportSize({ width: 390, height: 844 });
    await expect(cards(page)).toHaveCount(ROBOTS);
    await accessible(page);
  });
}

for (const width of [390, 320]) {
  test(`a phone shows the fleet without scrolling sideways, ${width} px`, async ({ page }) => {
    await page.setViewportSize({ width, height: 844 });
    await page.goto('/');
    await expect(cards(page)).toHaveCount(ROBOTS);
    expect(await sideways(page)).toBe(0);
    await page
      .getByRole('button', { name: /^Numbers of / })
      .first()
      .click();
    await expect(page.getByRole('complementary')).toBeVisible();
    expect(await sideways(page)).toBe(0);
  });
}

// The narrowest window with a table, and the usual ones.
for (const width of [900, 1_280, 1_440, 1_920]) {
  test(`nothing in the fleet's table is cut off, ${width} px`, async ({ page }) => {
    await page.setViewportSize({ width, height: 800 });
    await page.goto('/');
    await expect(page.getByRole('columnheader')).toHaveCount(7);
    await expect(page.getByRole('rowheader').first()).toBeVisible();
    const cutOff = await page
      .locator('thead th, td.needs')
      .evaluateAll((cells) =>
        cells.filter((cell) => cell.scrollWidth > cell.clientWidth).map((cell) => cell.textContent),
      );
    expect(cutOff).toEqual([]);
  });
}

test('a window that is too narrow for the table shows cards', async ({ page }) => {
  await page.setViewportSize({ width: 899, height: 800 });
  await page.goto('/');
  await expect(cards(page)).toHaveCount(ROBOTS);
  await expect(page.getByRole('columnheader')).toHaveCount(0);
});

test('an address without a page says so', async ({ page, account }) => {
  await page.goto('/robots/no_such_robot');
  await expect(page.getByRole('heading', { name: 'No robot has this name' })).toBeVisible();
  account.forgive(/status of 404/);
  await page.goto('/nowhere');
  await expect(page.getByRole('heading', { name: 'There is no such page' })).toBeVisible();
  await accessible(page);
});
