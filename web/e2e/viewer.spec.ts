import { accessible, expect, test } from './fixtures';

test.use({ as: 'viewer' });

test('a viewer sees everything and is told what others may do', async ({ page }) => {
  await page.goto('/');
  await expect(page.getByRole('banner')).toContainText('viewer');
  await page.getByRole('rowheader').first().getByRole('link').click();
  await expect(page.getByRole('heading', { name: 'Calibration in use' })).toBeVisible();
  await expect(page.getByText('Operators can report a reassembly here')).toBeVisible();
  await expect(page.getByRole('button', { name: /reassembled/ })).toHaveCount(0);
  await accessible(page);
});
