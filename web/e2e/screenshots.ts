/** Pictures for the documentation, made from the running demo. */

import { expect, test } from './fixtures';

const DOCS = '../docs';

test('fleet and robot', async ({ page }) => {
  await page.setViewportSize({ width: 1360, height: 580 });
  await page.goto('/');
  await expect(page.getByRole('rowheader')).toHaveCount(6);
  const calibrated = page.getByRole('row').filter({ hasText: 'Calibrated' });
  await expect(calibrated).toHaveCount(6, { timeout: 180_000 });
  await page.screenshot({ path: `${DOCS}/fleet.png` });
  await page.getByRole('rowheader').first().getByRole('link').click();
  await page.setViewportSize({ width: 1360, height: 1020 });
  const slider = page.getByRole('slider').first();
  await expect
    .poll(async () => Number(await slider.getAttribute('aria-valuemax')), { timeout: 180_000 })
    .toBeGreaterThan(120);
  await page.mouse.move(0, 0);
  await page.screenshot({ path: `${DOCS}/robot.png` });
});
