import { accessible, expect, sideways, test } from './fixtures';

test.use({ command: 'serve', own: 'guide', as: 'admin' });

/** Duration of a drive with its loops, some 60 m at 1 m/s. */
const DRIVE_S = 70;
/** Time within which a robot that drives at 1 m/s has been calibrated anew. */
const VERDICT_WITHIN_MS = 120_000;
/** Turn of the LiDAR's yaw in the workshop. */
const TURNED_DEG = 1.2;
/** Height of what a finger presses, px. */
const TOUCH_PX = 44;

test('a bracket is replaced, and the phone leads to "changed" with its value', async ({
  browser,
  service,
}) => {
  test.setTimeout(360_000);
  const phone = {
    baseURL: service.url,
    storageState: await service.signedIn('admin'),
    viewport: { width: 390, height: 844 },
    hasTouch: true,
  };
  const context = await browser.newContext(phone);
  const page = await context.newPage();
  const put = await page.request.put('/api/v1/robots/tugger_01', {
    headers: { 'if-none-match': '*' },
    data: { model: 'bicycle', wheelbase_m: 1.2 },
  });
  expect(put.ok()).toBe(true);
  await service.drive(DRIVE_S);

  await page.goto('/robots/tugger_01');
  await page.getByRole('link', { name: 'Guided calibration' }).tap();
  await expect(page).toHaveURL(/\/robots\/tugger_01\/guide$/);
  await expect(page.getByRole('heading', { name: 'tugger_01' })).toBeFocused();

  const verdict = page.getByRole('status').filter({ has: page.getByRole('heading') });
  const answer = (question: string) =>
    page.locator('dl > div').filter({ hasText: question }).locator('dd');
  await expect(verdict).toContainText('Nothing reported');
  const report = page.getByRole('button', { name: 'Report and start' });
  await report.tap();
  await expect(page.getByRole('alert').filter({ hasText: 'Choose' })).toBeVisible();
  await accessible(page);
  await page.getByText('Bracket', { exact: true }).tap();
  await report.tap();

  // Nothing has been driven since: no verdict is made up, and what is missing is named.
  await expect(report).toBeHidden();
  await expect(page.getByText('by ada: Bracket')).toBeVisible();
  await expect(verdict).not.toContainText(/Changed|Unchanged/);

  // Another phone shows the same, as long as it lasts.
  const other = await browser.newContext({ ...phone, viewport: { width: 320, height: 640 } });
  const second = await other.newPage();
  await second.goto('/robots/tugger_01/guide');
  const theirs = second.getByRole('status').filter({ has: second.getByRole('heading') });
  await expect(second.getByText('by ada: Bracket')).toBeVisible();

  service.simulate(1, TURNED_DEG);
  await Promise.all([verdict, theirs].map((shown) => expect(shown).toContainText('Not known yet')));
  expect(await sideways(second)).toBe(0);
  await expect(answer('May I drive?')).toHaveText('Yes, by hand');
  await expect(answer('Am I done?')).toHaveText(/^No, \d of 4 known$/);
  const drawing = page.getByRole('region', { name: 'What to drive' });
  await expect(drawing.getByRole('img')).toHaveAccessibleName(
    / on [\d.]+ × [\d.]+ m\. The robot is \d+ m along it\.$/,
  );
  await expect(answer('How far still?')).toHaveText(/^(About|At least) \d+ m, \d+ (s|min)$/);
  // All answers and the drawing are on the first screen.
  for (const part of [verdict, answer('How far still?'), answer('Where to?'), drawing]) {
    await expect(part).toBeInViewport({ ratio: 1 });
  }
  expect(await sideways(page)).toBe(0);
  const buttons = page.getByRole('main').locator('.button:visible');
  for (const button of await buttons.all()) {
    expect((await button.boundingBox())?.height).toBeGreaterThanOrEqual(TOUCH_PX);
  }
  await accessible(page);

  for (const shown of [verdict, theirs]) {
    await expect(shown).toContainText(/Changed.*LiDAR yaw by 1\.[12]\d*°/, {
      timeout: VERDICT_WITHIN_MS,
    });
  }
  await expect(page.getByRole('link', { name: 'Review proposal' })).toBeVisible({
    timeout: VERDICT_WITHIN_MS,
  });
  await expect(answer('May I drive?')).toHaveText('By hand only');
  await expect(answer('Am I done?')).toHaveText('With driving, yes');
  expect(await sideways(page)).toBe(0);
  await accessible(page);
  await page.reload();
  await expect(verdict).toContainText(/Changed.*LiDAR yaw by/);
  await other.close();
  await context.close();
});

test('a label leads to the guide, and says when no phone can open it', async ({ page }) => {
  await page.request.put('/api/v1/robots/tugger_02', {
    headers: { 'if-none-match': '*' },
    data: { model: 'bicycle', wheelbase_m: 1.2 },
  });
  await page.goto('/robots/tugger_02');
  await page.getByRole('button', { name: 'QR label…' }).click();
  const label = page.getByRole('dialog');
  await expect(label.getByRole('img', { name: /\/robots\/tugger_02\/guide$/ })).toBeVisible();
  await expect(label).toContainText('Only this machine can open this address.');
  await accessible(page);
  // The label alone is printed.
  await page.emulateMedia({ media: 'print' });
  await expect(label.getByRole('button', { name: 'Close' })).toBeHidden();
  await expect(page.getByRole('link', { name: 'Guided calibration' })).toBeHidden();
  await expect(label.getByRole('img')).toBeVisible();
});

test('a robot that sends nothing says why it cannot be calibrated', async ({ page }) => {
  await page.request.put('/api/v1/robots/tugger_03', {
    headers: { 'if-none-match': '*' },
    data: { model: 'bicycle', wheelbase_m: 1.2 },
  });
  await page.goto('/robots/tugger_03/guide');
  const status = page.getByRole('status').filter({ has: page.getByRole('heading') });
  await expect(status).toContainText('Nothing reported');
  await page.getByText('Other', { exact: true }).click();
  const report = page.getByRole('button', { name: 'Report and start' });
  await report.click();
  await expect(page.getByText('Say in a few words what was done.')).toBeVisible();
  await page.getByLabel('In words').fill('hit a rack');
  await report.click();
  await expect(status).toContainText('Cannot be calibrated');
  await expect(status).toContainText('The robot sends nothing.');
  await expect(page.getByText('by ada: hit a rack')).toBeVisible();
});
