import { readFile } from 'node:fs/promises';
import { accessible, expect, openPart, sideways, test } from './fixtures';

test('the data of the last minute are kept by a button and downloaded, two clicks from the values', async ({
  page,
}) => {
  await page.goto('/');
  await page.getByRole('rowheader').first().getByRole('link').click();
  await openPart(page, 'Evidence');
  await page.getByRole('button', { name: 'Keep the last minute' }).click();
  const list = page.getByRole('list', { name: 'Data of the moment, newest first' });
  const kept = list.getByRole('listitem').filter({ hasText: 'Kept' });
  await expect(kept).toHaveCount(1);
  const downloading = page.waitForEvent('download');
  await kept.getByRole('link', { name: /^Download/ }).click();
  const download = await downloading;
  expect(download.suggestedFilename()).toMatch(/^tugger_\d+-\d+\.mcap$/);
  const data = await readFile(await download.path());
  expect(data.subarray(1, 5).toString()).toBe('MCAP');
  expect(data.length).toBeGreaterThan(10_000);
  await accessible(page);
  await page.setViewportSize({ width: 320, height: 640 });
  expect(await sideways(page)).toBe(0);
});
