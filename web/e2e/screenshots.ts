/** Pictures for the documentation, made from the running demo. */

import { PROPOSED_WITHIN_MS, waiting } from './decisions';
import { expect, test, valueCharts } from './fixtures';

test.use({ as: 'approver', rate: 1 });

const DOCS = '../docs';

test('the main pages', async ({ page, browser, service }) => {
  const proposals = await waiting(page.request, 6);
  const [first, second, third] = proposals;
  const path = (name: string) => ({ path: `${DOCS}/${name}.png` });

  await page.setViewportSize({ width: 1440, height: 560 });
  await page.goto('/approvals');
  await page.getByRole('checkbox', { name: `Select the proposal for ${first?.robot}` }).check();
  await page.getByRole('checkbox', { name: `Select the proposal for ${second?.robot}` }).check();
  await page.screenshot(path('approvals'));
  await page.getByRole('button', { name: 'Approve 2' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Approve 2' }).click();
  await expect(page.getByText('2 of 2 approved.')).toBeVisible();

  await page.setViewportSize({ width: 1440, height: 900 });
  await page.goto(`/approvals/${third?.id}`);
  await expect(valueCharts(page)).toHaveCount(4);
  const slider = page.getByRole('slider').last();
  await expect
    .poll(async () => Number(await slider.getAttribute('aria-valuemax')))
    .toBeGreaterThan(20);
  await page.screenshot(path('approval'));

  await page.setViewportSize({ width: 1440, height: 620 });
  await page.goto('/alerts');
  await expect(
    page.getByRole('listitem').filter({ hasText: 'Needs calibration' }).first(),
  ).toBeVisible();
  await page.screenshot(path('alerts'));

  // The two that were approved drive until they are proven.
  await page.setViewportSize({ width: 1440, height: 780 });
  await page.goto('/');
  await expect(page.getByRole('row').filter({ hasText: 'Calibrated' })).toHaveCount(2, {
    timeout: 180_000,
  });
  await page.mouse.move(0, 0);
  await page.screenshot(path('fleet'));
  await page.getByRole('link', { name: first?.robot ?? '', exact: true }).click();
  await page.setViewportSize({ width: 1440, height: 1040 });
  await expect(page.getByText('Verified').first()).toBeVisible();
  await expect(page.getByText('after: generation 1')).toBeVisible();
  await page.mouse.move(0, 0);
  await page.screenshot(path('robot'));

  const dark = await browser.newContext({
    baseURL: service.url,
    storageState: await service.signedIn('approver'),
    colorScheme: 'dark',
    viewport: { width: 390, height: 844 },
    deviceScaleFactor: 2,
  });
  const phone = await dark.newPage();
  await phone.goto(`/approvals/${third?.id}`);
  await expect(phone.getByRole('button', { name: 'Approve' })).toBeVisible();
  await phone.screenshot(path('approval-phone'));
  await dark.close();
});

test.setTimeout(PROPOSED_WITHIN_MS + 300_000);
