import { waiting } from './decisions';
import { accessible, expect, test } from './fixtures';

test.use({ as: 'admin' });

const PAGES = [
  ['/', 'Fleet'],
  ['/approvals', 'Approvals'],
  ['/approvals?show=decided', 'Approvals'],
  ['/alerts', 'Alerts'],
  ['/alerts?state=normal', 'Alerts'],
  ['/audit', 'Audit'],
  ['/settings', 'Settings'],
  ['/settings/users', 'Settings'],
  ['/settings/tokens', 'Settings'],
  ['/settings/webhooks', 'Settings'],
  ['/health', 'Health'],
] as const;

const PHONE = { width: 390, height: 844 };

for (const colorScheme of ['light', 'dark'] as const) {
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
      await test.step(`${path} wide`, () => accessible(page));
      await page.setViewportSize(PHONE);
      await test.step(`${path} on a phone`, () => accessible(page));
      const sideways = await page.evaluate(
        () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
      );
      expect(sideways, `${path} scrolls sideways on a phone`).toBe(0);
    }
  });
}

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
