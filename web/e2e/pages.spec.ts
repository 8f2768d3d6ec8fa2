import { waiting } from './decisions';
import { accessible, expect, legible, sideways, test } from './fixtures';

test.use({ as: 'admin' });

const PAGES = [
  ['/', 'Fleet'],
  ['/approvals', 'Approvals'],
  ['/approvals?show=decided', 'Approvals'],
  ['/rollouts', 'Roll-outs'],
  ['/rollouts/new', 'New roll-out'],
  ['/alerts', 'Alerts'],
  ['/alerts?state=normal', 'Alerts'],
  ['/audit', 'Audit'],
  ['/certificates', 'Certificates'],
  ['/settings', 'Settings'],
  ['/settings/users', 'Settings'],
  ['/settings/tokens', 'Settings'],
  ['/settings/webhooks', 'Settings'],
  ['/health', 'Health'],
  ['/help', 'Help'],
] as const;

const PHONE = { width: 390, height: 844 };
/** A window of 1280 px at 400 %. */
const NARROWEST = { width: 320, height: 640 };

for (const [colorScheme, checked] of [
  ['light', accessible],
  ['dark', legible],
] as const) {
  test(`every page is accessible, wide and on a phone, ${colorScheme}`, async ({ page }) => {
    test.setTimeout(240_000);
    const [first] = await waiting(page.request, 1);
    await page.emulateMedia({ colorScheme });
    const pages = [...PAGES, [`/approvals/${first?.id}`, /^New calibration/] as const];
    for (const [path, heading] of pages) {
      await page.setViewportSize({ width: 1440, height: 900 });
      await page.goto(path);
      await expect(page.getByRole('heading', { level: 1, name: heading })).toBeVisible();
      await expect(page.getByText('Live', { exact: true })).toBeVisible();
      await page.waitForLoadState('load');
      await test.step(`${path} wide`, () => checked(page));
      await page.setViewportSize(PHONE);
      await test.step(`${path} on a phone`, () => checked(page));
      for (const size of [PHONE, NARROWEST]) {
        await page.setViewportSize(size);
        expect(await sideways(page), `${path} scrolls sideways at ${size.width} px`).toBe(0);
      }
    }
  });
}

test('the table of proposals fits a screen of 1440 px, with ids of twelve letters', async ({
  page,
}) => {
  await waiting(page.request, 1);
  await page.route(/\/api\/v1\/proposals\b/, async (route) => {
    const response = await route.fetch();
    await route.fulfill({ response, body: (await response.text()).replaceAll('_0', '_hall') });
  });
  await page.setViewportSize({ width: 1440, height: 900 });
  await page.goto('/approvals');
  const table = page.getByRole('table');
  const id = table.getByRole('rowheader').first();
  await expect(id).toHaveText(/^\w{12}$/);
  const cut = await table.evaluate(
    (element) => element.scrollWidth - (element.parentElement?.clientWidth ?? 0),
  );
  expect(cut).toBeLessThanOrEqual(0);
  // On one line.
  expect((await id.getByRole('link').boundingBox())?.height).toBeLessThan(30);
});

test('every page has help, glossary, API and version at its foot, and help needs no sign-in', async ({
  page,
  browser,
  service,
}) => {
  for (const path of ['/', '/alerts', '/settings', '/nowhere']) {
    await page.goto(path);
    const foot = page.getByRole('contentinfo');
    await expect(foot).toContainText('fleetcal finds each robot');
    await expect(foot).toContainText(/Version \d+\.\d+\.\d+/);
    await expect(foot.getByRole('link', { name: 'API' })).toHaveAttribute('href', '/docs/');
    // At the foot of the window, also under a page that does not fill it.
    const box = await foot.boundingBox();
    expect((box?.y ?? 0) + (box?.height ?? 0)).toBeGreaterThanOrEqual(899);
  }
  await page.getByRole('link', { name: 'Glossary' }).click();
  await expect(page.getByRole('heading', { name: 'Glossary' })).toBeInViewport();

  const context = await browser.newContext({
    baseURL: service.url,
    storageState: { cookies: [], origins: [] },
  });
  const stranger = await context.newPage();
  await stranger.goto('/');
  await expect(stranger.getByRole('main')).toContainText('fleetcal finds each robot');
  await stranger.getByRole('link', { name: 'Help' }).click();
  await expect(stranger.getByRole('heading', { level: 1, name: 'Help' })).toBeVisible();
  await accessible(stranger);
  await context.close();
});

test('the pages are reached by keyboard, each with its heading in focus', async ({ page }) => {
  await page.goto('/');
  await expect(page.getByRole('rowheader')).toHaveCount(6);
  for (const name of ['Approvals', 'Alerts', 'Audit', 'Settings', 'Health', 'Fleet']) {
    const link = page.getByRole('navigation', { name: 'Pages' }).getByRole('link', { name });
    await link.focus();
    await page.keyboard.press('Enter');
    await expect(page.getByRole('heading', { level: 1, name })).toBeFocused();
    await expect(link).toHaveAttribute('aria-current', 'page');
  }
});

test.describe('a viewer', () => {
  test.use({ as: 'viewer' });

  test('sees what waits and what is wrong, and nothing to press', async ({ page }) => {
    const [first] = await waiting(page.request, 1);
    await page.goto('/approvals');
    await expect(page.getByRole('rowheader').first()).toBeVisible();
    await expect(page.getByRole('checkbox')).toHaveCount(0);
    await expect(page.getByRole('button', { name: 'Freeze deployments' })).toHaveCount(0);
    await page.goto(`/approvals/${first?.id}`);
    await expect(page.getByText('An approver decides on this.')).toBeVisible();
    await expect(page.getByRole('button', { name: /Approve|Reject|Withdraw/ })).toHaveCount(0);
    await page.goto('/alerts');
    await expect(page.getByText('Unacknowledged').first()).toBeVisible();
    await expect(page.getByRole('button', { name: /^Acknowledge/ })).toHaveCount(0);
    await page.goto('/settings/users');
    await expect(page.getByText('Administrators only.')).toBeVisible();
  });
});
