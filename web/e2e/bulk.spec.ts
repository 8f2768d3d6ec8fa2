import type { Page } from '@playwright/test';
import { accessible, expect, sideways, test } from './fixtures';

test.use({ command: 'serve', own: 'bulk' });

const PARKED = 60;
const CLICKS_MAX = 5;

/** Registers the parked robots by one request, once. */
async function register(page: Page): Promise<void> {
  const table = Array.from(
    { length: PARKED },
    (_, i) => `agv_${String(i + 1).padStart(2, '0')},tricycle,1.2\n`,
  );
  const answer = await page.request.post('/api/v1/fleet/import', {
    headers: { 'content-type': 'text/csv' },
    data: `id,model,wheelbase_m\n${table.join('')}`,
  });
  expect([201, 422]).toContain(answer.status());
}

/** Counts the clicks on the page from now on. */
async function countClicks(page: Page): Promise<() => Promise<number>> {
  await page.evaluate(() => {
    const counted = globalThis as unknown as { clicks: number };
    counted.clicks = 0;
    // A label's click repeats at its control, and keys click too: a pointer goes down once.
    document.addEventListener('pointerdown', () => counted.clicks++, true);
  });
  return () => page.evaluate(() => (globalThis as unknown as { clicks: number }).clicks);
}

test('60 parked robots go into maintenance by at most 5 clicks, and out by one', async ({
  page,
}) => {
  await register(page);
  await page.goto('/');
  const all = page.getByRole('checkbox', { name: `Select all ${PARKED} in this view` });
  await expect(all).toBeVisible();
  const clicks = await countClicks(page);
  await all.click();
  const bar = page.getByRole('region', { name: 'Selection' });
  await expect(bar).toContainText(`${PARKED} selected`);
  await accessible(page);
  await bar.getByRole('button', { name: 'Maintenance' }).click();
  const dialog = page.getByRole('dialog');
  await dialog.getByLabel('Why').click();
  await page.keyboard.type('parked over the winter');
  await dialog.getByRole('button', { name: `Maintenance ${PARKED}` }).click();
  const outcome = page.getByRole('status').filter({ hasText: 'Maintenance: done' });
  await expect(outcome).toContainText(`done for ${PARKED} of ${PARKED} robots`);
  expect(await clicks()).toBeLessThanOrEqual(CLICKS_MAX);
  await expect(page.getByRole('link', { name: `In maintenance ${PARKED}` })).toBeVisible();
  await accessible(page);

  await outcome.getByRole('button', { name: `Undo ${PARKED}` }).click();
  await expect(outcome).toBeHidden();
  await expect(page.getByRole('link', { name: 'In maintenance' })).toBeHidden();
});

test('robots are selected by Shift and by keyboard', async ({ page }) => {
  await register(page);
  await page.goto('/');
  const box = (number: string) => page.getByRole('checkbox', { name: `Select agv_${number}` });
  const bar = page.getByRole('region', { name: 'Selection' });
  await box('02').click();
  await box('06').click({ modifiers: ['Shift'] });
  await expect(bar).toContainText('5 selected');
  await page.keyboard.press('Shift+ArrowDown');
  await page.keyboard.press('Shift+ArrowDown');
  await expect(box('08')).toBeChecked();
  await expect(bar).toContainText('7 selected');
  await page.getByRole('searchbox').fill('agv_02');
  await expect(bar).toContainText('1 selected');
  await expect(bar).toContainText('6 more outside this view');
  await bar.getByRole('button', { name: 'Clear selection' }).click();
  await expect(bar).toBeHidden();
});

test('a robot is retired on the fleet page and brought back', async ({ page }) => {
  await register(page);
  await page.goto('/?q=agv_6');
  await page.getByRole('checkbox', { name: 'Select agv_60' }).click();
  const bar = page.getByRole('region', { name: 'Selection' });
  await bar.getByRole('button', { name: 'Retire' }).click();
  const dialog = page.getByRole('dialog');
  await dialog.getByLabel('Why').fill('sold');
  await dialog.getByRole('button', { name: 'Retire 1' }).click();
  await expect(page.getByText('Retire: done for 1 of 1 robot')).toBeVisible();
  await page.goto('/');
  await expect(page.getByRole('table')).toHaveAttribute('aria-rowcount', String(PARKED));
  await page.getByText('1 retired robot').click();
  await page.getByRole('button', { name: 'Bring back… agv_60' }).click();
  await dialog.getByLabel('Why').fill('bought back');
  await dialog.getByRole('button', { name: 'Bring back' }).click();
  await expect(page.getByRole('table')).toHaveAttribute('aria-rowcount', String(PARKED + 1));
  await expect(page.getByText('1 retired robot')).toBeHidden();
});

test('on a phone too robots are selected and acted on', async ({ page }) => {
  await register(page);
  await page.setViewportSize({ width: 320, height: 640 });
  await page.goto('/?q=agv_01');
  await page.getByRole('checkbox', { name: 'Select agv_01' }).click();
  await expect(page.getByRole('region', { name: 'Selection' })).toContainText('1 selected');
  expect(await sideways(page)).toBeLessThanOrEqual(0);
  await accessible(page);
});

test('an edit of the vehicle says what restarts before it is saved', async ({ page }) => {
  await register(page);
  await page.goto('/robots/agv_05');
  await page.getByRole('button', { name: 'Edit vehicle' }).click();
  const dialog = page.getByRole('dialog', { name: 'Vehicle of agv_05' });
  await dialog.getByLabel('Wheelbase').fill('1,35');
  await expect(dialog).toContainText('The estimate begins again, since the wheelbase changes');
  await dialog.getByLabel('Forward').fill('430');
  await expect(dialog.getByRole('button', { name: 'Save' })).toBeDisabled();
  await dialog.getByLabel('Left').fill('0');
  await dialog.getByLabel('Yaw').fill('0');
  await expect(dialog).toContainText('the wheelbase and the nominal mount change');
  await accessible(page);
  await dialog.getByRole('button', { name: 'Save' }).click();
  await expect(dialog).toBeHidden();
  const { config } = await (await page.request.get('/api/v1/robots/agv_05')).json();
  expect(config).toMatchObject({ wheelbase_m: 1.35, nominal_extrinsics: { x_m: 0.43 } });
});
