import { DEMO_ROBOTS as ROBOTS } from './decisions';
import { accessible, expect, test } from './fixtures';

/** A simulated robot is calibrated this long after its start at the latest. */
const CALIBRATED_WITHIN_MS = 90_000;

test('the fleet has its six robots, and each is calibrated in time', async ({ page }) => {
  test.setTimeout(CALIBRATED_WITHIN_MS + 30_000);
  await page.goto('/');
  const rows = page.getByRole('row').filter({ has: page.getByRole('rowheader') });
  await expect(rows).toHaveCount(ROBOTS);
  for (const row of await rows.all()) {
    // Four parameters, each with a value and its sigma, and how far it is off what is applied.
    await expect(row.getByText(/^\s*[+\u2212]?\d+\.\d+ off(, beyond tolerance)?\s*$/)).toHaveCount(
      4,
      {
        timeout: CALIBRATED_WITHIN_MS,
      },
    );
    await expect(row.getByText(/^± \d+\.\d+$/)).toHaveCount(4);
    await expect(row.getByText('Online')).toBeVisible();
  }
  await expect(page.getByText('Live', { exact: true })).toBeVisible();
});

test('the page moves without being asked', async ({ page }) => {
  await page.goto('/');
  const row = page
    .getByRole('row')
    .filter({ has: page.getByRole('rowheader') })
    .first();
  const before = await row.innerText();
  await expect.poll(() => row.innerText(), { timeout: 20_000 }).not.toBe(before);
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
    await expect(page.getByRole('listitem')).toHaveCount(ROBOTS);
    await accessible(page);
  });
}

test('a phone shows the fleet without scrolling sideways', async ({ page }) => {
  await page.setViewportSize({ width: 390, height: 844 });
  await page.goto('/');
  await expect(page.getByRole('listitem')).toHaveCount(ROBOTS);
  const sideways = await page.evaluate(
    () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
  );
  expect(sideways).toBe(0);
});

// The narrowest window with a table, and the usual ones.
for (const width of [1_260, 1_280, 1_440, 1_920]) {
  test(`nothing in the fleet's table is cut off, ${width} px`, async ({ page }) => {
    await page.setViewportSize({ width, height: 800 });
    await page.goto('/');
    await expect(page.getByRole('columnheader')).toHaveCount(10);
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
  await page.setViewportSize({ width: 1_259, height: 800 });
  await page.goto('/');
  await expect(page.getByRole('listitem')).toHaveCount(ROBOTS);
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
