import { accessible, expect, test } from './fixtures';

test.use({ command: 'serve', own: 'silence', as: 'admin' });

/** A robot that stays away is shown as silent within this time. */
const SHOWN_WITHIN_MS = 30_000;

test('a silent robot is shown as such, and not green, also after a restart', async ({
  page,
  service,
  account,
}) => {
  test.setTimeout(180_000);
  service.simulate();
  await page.goto('/');
  const row = page.getByRole('row').filter({ has: page.getByRole('rowheader') });
  await expect(row).toHaveCount(1, { timeout: 40_000 });
  const name = (await row.getByRole('rowheader').getByRole('link').innerText()).trim();
  const given = await page.request.put(`/api/v1/robots/${name}`, {
    headers: { 'if-none-match': '*' },
    data: { model: 'bicycle', wheelbase_m: 1.2 },
  });
  expect(given.status()).toBe(201);
  await expect(row.locator('.state')).toContainText('Calibrating');
  await expect(row.getByText('Silent')).toHaveCount(0);

  await service.stopRobots();
  const silent = row.getByText('Silent', { exact: true });
  await expect(silent.last()).toBeVisible({ timeout: SHOWN_WITHIN_MS });
  await expect(page.getByText('1 is silent.')).toBeVisible();
  await expect(row.locator('svg.good, svg.active')).toHaveCount(0);
  await accessible(page);
  await page.getByRole('link', { name: 'Silent 1' }).click();
  await expect(page).toHaveURL(/connection=silent/);
  await expect(row).toHaveCount(1);

  await service.kill();
  await service.run();
  await page.goto('/');
  await expect(silent.last()).toBeVisible({ timeout: SHOWN_WITHIN_MS });
  await expect(row.locator('svg.good, svg.active')).toHaveCount(0);
  await page.goto(`/robots/${name}`);
  await expect(page.getByText('Silent', { exact: true }).first()).toBeVisible();

  // It was switched off on purpose: nobody misses it until that ends.
  await page.getByRole('button', { name: 'Set maintenance…' }).click();
  const dialog = page.getByRole('dialog');
  await dialog.getByRole('combobox', { name: 'For' }).selectOption('1 day');
  await dialog.getByRole('button', { name: 'Set maintenance' }).click();
  await expect(dialog.getByText('Enter a reason')).toBeVisible();
  await dialog.getByRole('textbox', { name: 'Why' }).fill('parked for the night');
  await accessible(page);
  await dialog.getByRole('button', { name: 'Set maintenance' }).click();
  await expect(page.getByText('In maintenance', { exact: true }).first()).toBeVisible();
  await expect(page.getByText(/says ada: parked for the night/)).toBeVisible();
  await page.goto('/?connection=maintenance');
  await expect(row.getByText(/^In maintenance/).first()).toBeVisible();
  await expect(page.getByText('1 in maintenance.')).toBeVisible();
  await page.goto(`/robots/${name}`);
  await page.getByRole('button', { name: 'End maintenance…' }).click();
  await dialog.getByRole('textbox', { name: 'Why' }).fill('back at work');
  await dialog.getByRole('button', { name: 'End maintenance' }).click();
  await expect(page.getByText('Silent', { exact: true }).first()).toBeVisible();
  await page.setViewportSize({ width: 390, height: 844 });
  await accessible(page);
  account.forgive(/ERR_CONNECTION_REFUSED|ERR_INCOMPLETE_CHUNKED|ERR_CONNECTION_RESET|ERR_EMPTY/);
});
