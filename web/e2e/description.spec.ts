import { accessible, expect, openPart, test } from './fixtures';

test.use({ command: 'serve', own: 'description' });

test('a robot that describes itself is set up by one click', async ({ page, service }) => {
  await page.goto('/');
  service.simulate();
  const row = page.getByRole('row').filter({ hasText: 'Not set up' });
  await row.getByRole('link', { name: 'Set up vehicle' }).click({ timeout: 40_000 });
  await expect(page.getByLabel('Wheelbase')).toHaveValue('1.2', { timeout: 15_000 });
  await page.getByText("Filled in from the robot's own description").click();
  await expect(page.getByText(/^Wheelbase: 1\.200 m, by URDF: /)).toBeVisible();
  // Its scan and the checks of what it sends, before anything is stored.
  await expect(page.getByRole('img', { name: /^Latest scan: \d{2,} returns$/ })).toBeVisible();
  await expect(page.getByText('Nothing is wrong so far.')).toBeVisible();
  await expect(page.getByRole('row').filter({ hasText: 'wheel odometry' })).toHaveCount(1);
  await accessible(page);
  await page.getByRole('button', { name: 'Start calibration' }).click();
  await openPart(page, 'Evidence');
  await expect(page.getByRole('heading', { name: 'What the robot says of itself' })).toBeVisible();
  const described = page.getByRole('row').filter({ hasText: 'URDF: rear_left_wheel_joint' });
  await expect(described.filter({ hasText: '1.200 m' })).toHaveCount(1);
  // All of it is in use.
  await expect(page.getByRole('button', { name: 'Use what it says' })).toHaveCount(0);
  await accessible(page);
});
