import { expect, test } from './fixtures';

test.use({ command: 'serve', own: 'reassembly', as: 'admin' });

/** Duration of a drive with its loops, some 60 m at 1 m/s. */
const DRIVE_S = 70;
/** Turn of the LiDAR's yaw in the workshop. */
const TURNED_DEG = 1.2;

test('the verdict on a reassembly appears on the open page, by touch', async ({
  browser,
  service,
}) => {
  test.setTimeout(180_000);
  const context = await browser.newContext({
    baseURL: service.url,
    storageState: await service.signedIn('admin'),
    viewport: { width: 390, height: 844 },
    hasTouch: true,
  });
  const page = await context.newPage();
  const put = await page.request.put('/api/v1/robots/tugger_01', {
    headers: { 'if-none-match': '*' },
    data: { model: 'bicycle', wheelbase_m: 1.2 },
  });
  expect(put.ok()).toBe(true);
  await service.drive(DRIVE_S);
  await page.goto('/robots/tugger_01');
  const verdict = page.locator('section').filter({
    has: page.getByRole('heading', { name: 'After the reassembly' }),
  });
  const report = async (note: string) => {
    await page.getByRole('button', { name: 'Report reassembly…' }).tap();
    const dialog = page.getByRole('dialog');
    await dialog.getByLabel('What was done').fill(note);
    await dialog.getByRole('button', { name: 'Report', exact: true }).tap();
    await expect(dialog).toBeHidden();
    await expect(verdict).toContainText(note);
    // By who said so, not by the robot.
    const item = page.getByRole('listitem').filter({ hasText: note });
    await expect(item).toContainText('ada');
    await expect(verdict).toContainText('Not known yet');
  };

  await report('LiDAR moved');
  // Longer than any answer takes: nothing is made up meanwhile.
  await page.waitForTimeout(11_000);
  await expect(verdict).toContainText('Not known yet');
  await service.drive(DRIVE_S, TURNED_DEG);
  await expect(verdict).toContainText('Changed');
  await expect(verdict).toContainText(/LiDAR yaw by \+?1\.(19|20)\d*°/);

  await report('LiDAR cleaned');
  await service.drive(DRIVE_S, TURNED_DEG);
  await expect(verdict).toContainText('Unchanged');
  const confirmed = page.getByRole('listitem').filter({ hasText: 'Calibration confirmed' });
  await expect(confirmed).toContainText('It agrees with the calibration of before.');
  await context.close();
});
