import { DEMO_ROBOTS, PROPOSED_WITHIN_MS, waiting } from './decisions';
import { accessible, expect, sideways, test } from './fixtures';

test.use({ as: 'approver', own: 'rollouts' });

/** A wave of the demo is verified this long after its begin. */
const VERIFIED_WITHIN_MS = 120_000;
/** A resumed roll-out begins its next wave within this time, beside other tests. */
const RELEASED_WITHIN_MS = 30_000;

test('a person plans a roll-out, starts, pauses and follows it', async ({ page }) => {
  test.setTimeout(PROPOSED_WITHIN_MS + VERIFIED_WITHIN_MS + 60_000);
  await waiting(page.request, DEMO_ROBOTS);
  await page.goto('/approvals');
  await page.getByRole('link', { name: 'Roll-outs' }).click();
  await expect(page.getByText('No roll-outs yet.')).toBeVisible();
  await page.getByRole('link', { name: 'New roll-out' }).click();
  const plan = page.getByRole('region', { name: 'Plan' });
  await expect(plan.getByRole('rowheader')).toHaveText(['1 2 robots', '2 20 %', '3 the rest']);
  await accessible(page);

  // What is typed makes the plan void; a wrong number is named.
  await page.getByLabel('Wave 1: Number').fill('0');
  await expect(plan).toBeHidden();
  await page.getByRole('button', { name: 'Show the plan' }).click();
  await expect(page.getByText('Wave 1: the number of robots must be 1 or more')).toBeVisible();
  await page.getByLabel('Wave 1: Number').fill('1');
  await page.getByRole('button', { name: 'Remove wave 2' }).click();
  await page.getByRole('button', { name: 'Show the plan' }).click();
  await expect(plan.getByRole('rowheader')).toHaveText(['1 1 robot', '2 the rest']);
  await plan.getByLabel('Why').fill('spring');
  await plan.getByRole('button', { name: /^Approve \d+ and start$/ }).click();

  await expect(page.getByRole('heading', { level: 1, name: 'Roll-out 1' })).toBeVisible();
  const robots = page.getByRole('table', { name: /^Robots of the roll-out/ });
  await expect(robots.getByRole('row', { name: /Under way/ })).toHaveCount(1);
  await expect(robots.getByRole('row', { name: /Waiting/ })).not.toHaveCount(0);
  await accessible(page);
  for (const width of [390, 320]) {
    await page.setViewportSize({ width, height: 844 });
    expect(await sideways(page), `${width} px`).toBe(0);
  }
  await accessible(page);
  await page.setViewportSize({ width: 1440, height: 900 });

  await page.getByRole('button', { name: 'Pause…' }).click();
  await page.getByRole('dialog').getByLabel('Why').fill('lunch');
  await page.getByRole('dialog').getByRole('button', { name: 'Pause' }).click();
  await expect(page.getByText('Paused', { exact: true })).toBeVisible();
  await expect(robots.getByRole('row', { name: /Verified/ })).toHaveCount(1, {
    timeout: VERIFIED_WITHIN_MS,
  });
  await expect(robots.getByRole('row', { name: /Waiting/ })).not.toHaveCount(0);
  await page.getByRole('button', { name: 'Resume…' }).click();
  await page.getByRole('dialog').getByLabel('Why').fill('back');
  await expect(page.getByRole('dialog')).toContainText('Nothing is accepted');
  await page.getByRole('dialog').getByRole('button', { name: 'Resume' }).click();
  await expect(robots.getByRole('row', { name: /Waiting/ })).toHaveCount(0, {
    timeout: RELEASED_WITHIN_MS,
  });
  await page.getByRole('link', { name: /^Under way \d/ }).click();
  await expect(page).toHaveURL(/stage=underway/);

  // A row of the list, and rows of the audit.
  await page.goto('/rollouts');
  await expect(page.getByRole('row', { name: /^Roll-out 1/ })).toContainText('2 of 2 begun');
  await page.goto('/audit?action=rollout');
  await expect(page.getByRole('row', { name: /rollout.pause/ })).toContainText('lunch');
});
