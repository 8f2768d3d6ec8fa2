import { accessible, expect, openPart, test, valueCharts } from './fixtures';

test.use({ command: 'serve' });

test('a fleet without robots says how one appears', async ({ page }) => {
  await page.goto('/');
  await expect(page.getByRole('heading', { name: 'No robot has sent anything yet' })).toBeVisible();
  await accessible(page);
});

test('a robot that nobody knows is given its vehicle, by keyboard alone', async ({
  page,
  service,
}) => {
  await page.goto('/');
  service.simulate();
  const row = page.getByRole('row').filter({ hasText: 'Not set up' });
  // What the first messages did not say yet is shown as it comes, without a reload.
  await expect(row).toContainText(/speed and steering\s+\d+ Hz, LiDAR scans\s+\d+ Hz/, {
    timeout: 40_000,
  });
  await row.getByRole('link', { name: 'Set up vehicle' }).focus();
  await page.keyboard.press('Enter');
  await expect(page.getByRole('heading', { name: 'Set up vehicle' })).toBeVisible();
  await accessible(page);

  const wheelbase = page.getByLabel('Wheelbase');
  const submit = page.getByRole('button', { name: 'Start calibration' });
  await wheelbase.fill('1200 mm');
  await submit.press('Enter');
  await expect(page.getByText('"1200 mm" is not a number of metres')).toBeVisible();
  await expect(wheelbase).toBeFocused();
  await accessible(page);

  await page.getByRole('radio', { name: /^Steered front axle/ }).focus();
  await page.keyboard.press('ArrowDown');
  await page.keyboard.press('ArrowUp');
  await wheelbase.fill('1,2');
  await wheelbase.press('Enter');
  await openPart(page, 'History');
  await expect(valueCharts(page)).toHaveCount(4);
  await expect(page.getByText('bicycle, wheelbase 1.200 m')).toBeVisible();
  // The first estimate comes within a minute of driving.
  const slider = page.getByRole('slider').first();
  await expect
    .poll(async () => Number(await slider.getAttribute('aria-valuemax')), { timeout: 50_000 })
    .toBeGreaterThan(2);
});
