import { readFile } from 'node:fs/promises';
import { another, DEMO_ROBOTS, proposal, PROPOSED_WITHIN_MS, tabTo, waiting } from './decisions';
import { accessible, expect, openPart, test, valueCharts } from './fixtures';

test.use({ as: 'approver', own: 'approval' });
test.describe.configure({ mode: 'serial' });
test.setTimeout(PROPOSED_WITHIN_MS + 60_000);

/** A robot of the demo has driven far enough for a verdict this long after the approval. */
const VERIFIED_WITHIN_MS = 120_000;

const CHANGED = 'Updated while you were viewing.';

test('a calibration is approved by keyboard alone', async ({ page }) => {
  const [first] = await waiting(page.request, DEMO_ROBOTS);
  if (!first) throw new Error('nothing is proposed');
  await page.goto('/');
  await tabTo(page, 'link', /^Approvals/);
  await page.keyboard.press('Enter');
  await expect(page.getByRole('heading', { name: 'Approvals' })).toBeFocused();
  await tabTo(page, 'link', first.robot);
  await page.keyboard.press('Enter');
  await expect(
    page.getByRole('heading', { name: `New calibration for ${first.robot}` }),
  ).toBeFocused();
  // Old, new, difference and sigma of each value, and the history around it.
  for (const label of ['Steering offset', 'LiDAR x', 'LiDAR y', 'LiDAR yaw']) {
    const row = page.getByRole('row').filter({ hasText: new RegExp(`${label}\\s`) });
    // Of what is proposed, and of the estimate now.
    await expect(row.getByRole('cell').getByText(/^± \d+\.\d+$/)).toHaveCount(2);
  }
  // And whatever else the robot would apply.
  const { values } = (await proposal(page.request, first.id)).revision;
  const rows = page.getByRole('row').filter({ has: page.getByRole('rowheader') });
  const labels = await rows.getByRole('rowheader').allInnerTexts();
  const beside = [
    ['Speed scale', values.speed_scale],
    ['Time offset', values.time_offset_s],
    ['Steering gain', values.steering_gain],
    ['Wheelbase', values.wheelbase_m],
  ] as const;
  for (const [label, value] of beside) {
    const shown = labels.some((text) => text.startsWith(label));
    expect(shown, label).toBe(typeof value === 'number');
  }
  await expect(page.getByRole('figure')).toHaveCount(4);
  await accessible(page);
  await tabTo(page, 'button', 'Approve');
  await page.keyboard.press('Enter');
  await expect(page.getByRole('heading', { name: 'Approved', exact: true })).toBeVisible();
  expect((await proposal(page.request, first.id)).state).toBe('approved');
});

test('two browsers race for one approval, and one is told that it changed', async ({
  page,
  browser,
  service,
  account,
}) => {
  const [first] = await waiting(page.request, 1);
  if (!first) throw new Error('nothing is proposed');
  const other = await another(browser, service, 'approver2');
  const pages = [page, other];
  for (const one of pages) {
    await one.goto(`/approvals/${first.id}`);
    await expect(one.getByRole('button', { name: 'Approve' })).toBeEnabled();
  }
  const click = (element: HTMLElement) => element.click();
  await Promise.all(
    pages.map((one) => one.getByRole('button', { name: 'Approve' }).evaluate(click)),
  );
  const decided = (one: typeof page) => one.getByRole('heading', { name: 'Approved', exact: true });
  for (const one of pages) await expect(decided(one).or(one.getByText(CHANGED))).toBeVisible();
  const winners = await Promise.all(pages.map((one) => decided(one).isVisible()));
  const losers = await Promise.all(pages.map((one) => one.getByText(CHANGED).isVisible()));
  expect(winners.toSorted()).toEqual([false, true]);
  expect(losers).toEqual(winners.map((won) => !won));
  const loser = pages[losers.indexOf(true)] ?? page;
  await accessible(loser);
  await loser.getByRole('button', { name: 'Show current version' }).click();
  await expect(decided(loser)).toBeVisible();
  await other.context().close();
  account.forgive(/status of 412/);
});

test('a decision that comes too late is told, also to a page that hears nothing', async ({
  page,
  browser,
  service,
}) => {
  const [first] = await waiting(page.request, 1);
  if (!first) throw new Error('nothing is proposed');
  const deaf = await another(browser, service, 'approver2');
  await deaf.route('**/api/v1/stream', (route) => route.abort());
  await deaf.goto(`/approvals/${first.id}`);
  await expect(deaf.getByRole('button', { name: 'Reject' })).toBeEnabled();
  await page.goto(`/approvals/${first.id}`);
  await page.getByRole('button', { name: 'Reject' }).click();
  await expect(page.getByText('Give a reason to reject it')).toBeVisible();
  await page.getByLabel('Reason').fill('Bracket is loose: <b>mend it first</b>');
  await page.getByRole('button', { name: 'Reject' }).click();
  await expect(page.getByRole('heading', { name: 'Rejected' })).toBeVisible();
  await expect(page.getByText('Bracket is loose: <b>mend it first</b>')).toBeVisible();

  await deaf.getByRole('button', { name: 'Approve' }).click();
  await expect(deaf.getByText(CHANGED)).toBeVisible();
  await expect(deaf.getByText('It is now: rejected by approver.')).toBeVisible();
  expect((await proposal(page.request, first.id)).state).toBe('rejected');
  await deaf.context().close();

  await page.goto('/approvals?show=decided');
  await expect(page.getByRole('row').filter({ hasText: 'Bracket is loose' })).toContainText(
    'Rejected',
  );
  await accessible(page);
});

test('the deployment freeze says why and by whom, on every page', async ({ page }) => {
  await page.goto('/approvals');
  await page.getByRole('button', { name: 'Freeze deployments' }).click();
  const dialog = page.getByRole('dialog');
  await dialog.getByRole('button', { name: 'Freeze deployments' }).click();
  await expect(dialog.getByText('Enter a reason')).toBeVisible();
  await accessible(page);
  await dialog.getByLabel('Why').fill('Visitors in the hall');
  await dialog.getByRole('button', { name: 'Freeze deployments' }).click();
  const banner = page.getByText('Deployments are frozen: no new calibrations are sent to robots.');
  await expect(banner).toBeVisible();
  await page.goto('/');
  await expect(banner).toBeVisible();
  await expect(page.getByRole('main')).toContainText(
    /Visitors in the hall \(approver, (yesterday )?\d\d:\d\d\)/,
  );
  await accessible(page);
});

test('an open dialog never changes its action', async ({ page, browser, service }) => {
  const other = await another(browser, service, 'approver2');
  await other.goto('/approvals');
  await other.getByRole('button', { name: 'Resume deployments' }).click();
  const dialog = other.getByRole('dialog');
  await dialog.getByLabel('Why').fill('They are gone');

  const set = async (frozen: boolean) => {
    const headers = (await page.request.get('/api/v1/deployments/freeze')).headers();
    const answer = await page.request.put('/api/v1/deployments/freeze', {
      headers: { 'if-match': headers['etag'] ?? '' },
      data: { frozen, reason: 'Visitors in the hall' },
    });
    expect(answer.status()).toBe(200);
  };
  const resume = dialog.getByRole('button', { name: 'Resume deployments' });
  const painted = () => resume.evaluate((button) => getComputedStyle(button).backgroundColor);
  const enabled = await painted();
  await set(false);
  await expect(dialog.getByRole('alert')).toContainText('approver resumed deployments meanwhile.');
  await expect(dialog.getByRole('heading')).toHaveText('Resume deployments');
  await expect(resume).toBeDisabled();
  expect(await painted(), 'a disabled button looks so').not.toBe(enabled);
  await expect(dialog.getByRole('button', { name: 'Freeze' })).toHaveCount(0);
  await accessible(other);
  await dialog.getByRole('button', { name: 'Cancel' }).click();
  await set(true);
  await other.context().close();
});

test('several are approved at once, and wait for the end of the stop', async ({ page }) => {
  const proposals = await waiting(page.request, 2);
  await page.goto('/approvals');
  await page.getByRole('checkbox', { name: 'Select all' }).check();
  await expect(page.getByText(`${proposals.length} selected`)).toBeVisible();
  await accessible(page);
  const approve = page.getByRole('button', { name: `Approve ${proposals.length}` });
  await approve.first().click();
  const dialog = page.getByRole('dialog');
  await dialog.getByLabel('Why').fill('Checked together');
  await dialog.getByRole('button', { name: /^Approve/ }).click();
  const count = proposals.length;
  await expect(page.getByText(`${count} of ${count} approved.`)).toBeVisible();
  for (const { id } of proposals) {
    await expect(page.locator(`tbody a[href="/approvals/${id}"]`)).toHaveCount(0);
  }

  const robot = proposals[0]?.robot ?? '';
  await page.goto(`/robots/${robot}`);
  await expect(page.getByText('(deployments are frozen)')).toBeVisible();
  await page.goto('/approvals');
  await page.getByRole('button', { name: 'Resume deployments' }).click();
  await page.getByRole('dialog').getByLabel('Why').fill('They are gone');
  await page.getByRole('dialog').getByRole('button', { name: 'Resume deployments' }).click();
  await expect(
    page.getByText('Deployments are frozen: no new calibrations are sent to robots.'),
  ).toBeHidden();
  await page.goto(`/robots/${robot}`);
  await expect(page.getByText(/^(Verifying|Verified)/).first()).toBeVisible({ timeout: 60_000 });
});

test('a calibration is rolled back, with a reason, and stands among the deployments', async ({
  page,
}) => {
  await page.goto('/approvals?show=decided');
  const row = page.getByRole('row').filter({ hasText: 'Checked together' }).first();
  await row.getByRole('link').click();
  await page.getByRole('link', { name: 'Robot page', exact: true }).click();
  await openPart(page, 'History');
  await expect(valueCharts(page)).toHaveCount(4);
  await expect(valueCharts(page).first()).toContainText('applied');
  await openPart(page, 'Overview');
  await page.getByRole('button', { name: 'Roll back' }).click();
  const dialog = page.getByRole('dialog');
  await accessible(page);
  await dialog.getByLabel('Why').fill('It pulls to the left');
  await dialog.getByRole('button', { name: 'Roll back' }).click();
  await expect(dialog).toBeHidden();
  await expect(page.getByText('Rolled back').first()).toBeVisible({ timeout: 60_000 });
  await expect(page.getByText('It pulls to the left').first()).toBeVisible();
  await expect(page.getByText('Generation 2').first()).toBeVisible();
});

test('a verified calibration has a certificate to print and to save', async ({ page }) => {
  test.setTimeout(VERIFIED_WITHIN_MS + 60_000);
  const newest = async () => {
    const answer = await page.request.get('/api/v1/certificates');
    const { items } = (await answer.json()) as { items: { number: number; robot: string }[] };
    return items[0];
  };
  await expect.poll(newest, { timeout: VERIFIED_WITHIN_MS }).toBeDefined();
  const certificate = await newest();
  if (!certificate) throw new Error('nothing is certified');
  const { number, robot } = certificate;
  await page.goto(`/certificates?robot=${robot}`);
  const link = page.getByRole('link', { name: `Certificate ${number}`, exact: true });
  await expect(link).toBeVisible();
  await page.goto(`/robots/${robot}?show=history`);
  const download = page.waitForEvent('download');
  await page.getByRole('link', { name: `JSON of certificate ${number}` }).click();
  const file = await readFile(await (await download).path(), 'utf8');
  expect(file).toMatch(/^\{"document":/);
  await link.click();
  const title = `Calibration certificate ${number} of ${robot}`;
  await expect(page.getByRole('heading', { level: 1, name: title })).toBeVisible();
  await expect(page.getByText('Cross-track error')).toBeVisible();
  await accessible(page);
});

test.describe('an operator', () => {
  test.use({ as: 'operator' });

  test('proposes and withdraws, and cannot approve', async ({ page }) => {
    const answer = await page.request.get('/api/v1/robots?limit=100');
    const { items } = (await answer.json()) as {
      items: { id: string; calibration: { proposal: number | null; deployment: string | null } }[];
    };
    const over = ['verified', 'rolled_back', null];
    const free = items.find(
      ({ calibration }) => calibration.proposal === null && over.includes(calibration.deployment),
    );
    if (!free) throw new Error('no robot is free for a proposal');
    await page.goto(`/robots/${free.id}`);
    await page.getByRole('button', { name: 'Propose current estimate' }).click();
    await page.getByRole('dialog').getByLabel('Why').fill('Measured by hand');
    await page.getByRole('dialog').getByRole('button', { name: 'Propose' }).click();
    await expect(
      page.getByRole('heading', { name: `New calibration for ${free.id}` }),
    ).toBeVisible();
    await expect(page.getByText('An approver decides on this.')).toBeVisible();
    await expect(page.getByRole('button', { name: 'Approve' })).toHaveCount(0);
    await page.getByLabel('Reason').fill('Wrong robot');
    await page.getByRole('button', { name: 'Withdraw' }).click();
    await expect(page.getByRole('heading', { name: 'Withdrawn' })).toBeVisible();
  });
});
