import { accessible, expect, test } from './fixtures';

test.use({ command: 'serve', own: 'outage', as: 'admin' });

/** Robots that stay away are shown as silent, and alerted, within this time. */
const SHOWN_WITHIN_MS = 30_000;
/** Robots that stay away together; from five on they share an alert. */
const ROBOTS = 6;

test('robots that stay away after a restart are shown and raise one alert', async ({
  page,
  service,
  account,
}) => {
  test.setTimeout(180_000);
  service.simulate(ROBOTS);
  await page.goto('/');
  const rows = page.getByRole('row').filter({ has: page.getByRole('rowheader') });
  await expect(rows).toHaveCount(ROBOTS, { timeout: 60_000 });
  const names = await rows.getByRole('rowheader').getByRole('link').allInnerTexts();
  for (const name of names) {
    const given = await page.request.put(`/api/v1/robots/${name.trim()}`, {
      headers: { 'if-none-match': '*' },
      data: { model: 'bicycle', wheelbase_m: 1.2 },
    });
    expect(given.status()).toBe(201);
  }
  await expect(rows.locator('.state').filter({ hasText: 'Calibrating' })).toHaveCount(ROBOTS);
  // What they send has to be stored before the service is killed.
  await page.waitForTimeout(15_000);
  await service.kill();
  await service.stopRobots();
  await service.run();
  const started = Date.now();
  await page.goto('/');
  await expect(page.getByText(`${ROBOTS} are silent.`)).toBeVisible({
    timeout: SHOWN_WITHIN_MS,
  });
  await expect(rows.locator('svg.good, svg.active')).toHaveCount(0);
  await page.goto('/alerts');
  const alert = page.getByRole('listitem').filter({ hasText: `${ROBOTS} of ${ROBOTS} robots` });
  const left_ms = SHOWN_WITHIN_MS - (Date.now() - started);
  await expect(alert.getByText('Alerting')).toBeVisible({ timeout: left_ms });
  await expect(page.getByText('Silent', { exact: true })).toHaveCount(1);
  await alert.getByText(`All ${ROBOTS} robots`).click();
  await expect(alert.getByRole('link', { name: names[0]?.trim() ?? '' })).toBeVisible();
  await accessible(page);
  account.forgive(/ERR_CONNECTION_REFUSED|ERR_INCOMPLETE_CHUNKED|ERR_CONNECTION_RESET|ERR_EMPTY/);
});
