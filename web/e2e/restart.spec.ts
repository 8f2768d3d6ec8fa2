import { expect, test } from './fixtures';

// Stamps of robots that ran ahead would go back with a restart.
test.use({ own: 'restart', rate: 1 });

test('a page finds the service again after it was killed', async ({ page, service, account }) => {
  await page.goto('/');
  await expect(page.getByRole('rowheader')).toHaveCount(6);
  await expect(page.getByText('Live', { exact: true })).toBeVisible();
  await service.kill();
  await expect(page.getByText(/^Not connected/)).toBeVisible();
  // What was known stays on the page.
  await expect(page.getByRole('rowheader')).toHaveCount(6);
  await service.run();
  await expect(page.getByText('Live', { exact: true })).toBeVisible({ timeout: 30_000 });
  await expect(page.getByRole('rowheader').first()).toBeVisible();
  const row = page
    .getByRole('row')
    .filter({ has: page.getByRole('rowheader') })
    .first();
  await row.getByRole('button', { name: /^Numbers of / }).click();
  const numbers = page.getByRole('complementary');
  await expect(numbers.getByText('Online')).toBeVisible({ timeout: 20_000 });
  account.forgive(/ERR_CONNECTION_REFUSED|ERR_INCOMPLETE_CHUNKED|ERR_CONNECTION_RESET|ERR_EMPTY/);
});
