import type { Page } from '@playwright/test';
import { DEMO_ROBOTS, PROPOSED_WITHIN_MS, waiting, type Proposal } from './decisions';
import { accessible, expect, test, valueCharts } from './fixtures';

// Slowly enough for a deployment to be seen on two pages while it is verified.
test.use({ as: 'approver', own: 'trust', rate: 2 });
test.setTimeout(PROPOSED_WITHIN_MS + 120_000);

/** Pixels of a chart's canvas that have the colour of its line. */
function drawn(page: Page): Promise<number> {
  return page
    .getByRole('figure')
    .first()
    .locator('canvas')
    .evaluate((canvas: HTMLCanvasElement) => {
      const probe = document.createElement('span');
      probe.style.color = 'var(--accent)';
      document.body.append(probe);
      const [r, g, b] = (getComputedStyle(probe).color.match(/[\d.]+/g) ?? []).map(Number);
      probe.remove();
      const { data } = canvas.getContext('2d')?.getImageData(0, 0, canvas.width, canvas.height) ?? {
        data: [],
      };
      let count = 0;
      for (let i = 0; i < data.length; i += 4) {
        const same = data[i] === r && data[i + 1] === g && data[i + 2] === b;
        if (same && data[i + 3] === 255) count++;
      }
      return count;
    });
}

test('a single bucket of history is drawn', async ({ page }) => {
  const [first] = await waiting(page.request, 1);
  await page.goto(`/robots/${first?.robot}?range=5y`);
  await expect(valueCharts(page)).toHaveCount(4);
  const slider = page.getByRole('slider').first();
  await expect(slider).toHaveAttribute('aria-label', / 1 points\.$/);
  expect(await drawn(page)).toBeGreaterThan(15);
});

test('a typed reason outlives a link', async ({ page }) => {
  const [first] = await waiting(page.request, 1);
  if (!first) throw new Error('nothing is proposed');
  await page.goto(`/approvals/${first.id}`);
  await page.getByLabel('Reason').fill('Bracket was tightened');
  await page.getByRole('link', { name: 'Robot page', exact: true }).click();
  await expect(page.getByRole('heading', { name: 'Calibration in use' })).toBeVisible();
  await page.goBack();
  await expect(page.getByLabel('Reason')).toHaveValue('Bracket was tightened');
});

test('a tablet selects and decides by touch', async ({ browser, service }) => {
  const context = await browser.newContext({
    baseURL: service.url,
    storageState: await service.signedIn('approver'),
    viewport: { width: 1024, height: 768 },
    hasTouch: true,
  });
  const page = await context.newPage();
  // Every robot of the demo has its proposal, so that none is added to the list meanwhile.
  const proposals = await waiting(page.request, DEMO_ROBOTS);
  await page.goto('/approvals');
  const box = page.getByRole('checkbox', {
    name: `Select the proposal for ${proposals[0]?.robot}`,
  });
  const size = await box.locator('..').boundingBox();
  expect(Math.min(size?.width ?? 0, size?.height ?? 0)).toBeGreaterThanOrEqual(44);
  await box.tap();
  await expect(page.getByText('1 selected')).toBeVisible();
  await page.getByRole('checkbox', { name: 'Select all' }).tap();
  await expect(page.getByText(`${proposals.length} selected`)).toBeVisible();
  await accessible(page);

  // The dialog sums them up, and its buttons are in view however low the screen is.
  await page.setViewportSize({ width: 1024, height: 420 });
  await page.getByRole('button', { name: `Approve ${proposals.length}` }).tap();
  const dialog = page.getByRole('dialog');
  const largest = dialog.getByRole('table', { name: 'Largest change of each value' });
  await expect(largest.getByRole('row')).toHaveCount(4);
  await dialog.getByText(`All ${proposals.length} robots`).tap();
  await expect(dialog.getByRole('button', { name: /^Approve/ })).toBeInViewport({ ratio: 1 });
  await accessible(page);
  await context.close();
});

test('the estimate of now stands beside a proposal', async ({ page }) => {
  const [first] = await waiting(page.request, 1);
  await page.goto(`/approvals/${first?.id}`);
  await expect(page.getByText(/^Still holds: (yes|no), \d+\.\d sigma\.$/)).toBeVisible();
  await expect(page.getByRole('columnheader', { name: 'Estimate now' })).toBeVisible();
  await accessible(page);
});

test('a decision is followed to its end where it was made', async ({ page }) => {
  // That of the LiDAR farthest from the axle, whose position is the least certain.
  const lidarX = ({ revision }: Proposal) => revision.values.lidar_x_m ?? 0;
  const proposals = await waiting(page.request, DEMO_ROBOTS);
  const [first] = proposals.toSorted((one, other) => lidarX(other) - lidarX(one));
  if (!first) throw new Error('nothing is proposed');
  await page.goto(`/approvals/${first.id}`);
  await page.getByRole('button', { name: 'Approve' }).click();
  const progress = page.getByRole('list', { name: 'Progress of the deployment' });
  await expect(progress).toContainText('Approved');
  const verifying = progress.getByText(/^Verifying, \d+ of 60 m/);
  await expect(verifying).toBeVisible({ timeout: 60_000 });
  const driven = async () => Number(/(\d+) of/.exec(await verifying.innerText())?.[1]);
  const before = await driven();
  await expect.poll(driven, { timeout: 6_000 }).toBeGreaterThan(before);
  await accessible(page);
  await page.goto('/');
  const row = page.getByRole('row').filter({ hasText: first.robot });
  await expect(row.getByText(/^Verifying, \d+ of 60 m/)).toBeVisible();

  // It stays readable when it has ended, there and on the robot's page.
  await page.goto(`/approvals/${first.id}`);
  await expect(progress.getByText(/^Verified over \d+ m/)).toBeVisible({ timeout: 120_000 });
  await page.goto(`/robots/${first.robot}`);
  await expect(progress.getByText(/^Verified over \d+ m/)).toBeVisible();

  // The way back says which values return.
  await page.getByRole('button', { name: 'Roll back' }).click();
  const dialog = page.getByRole('dialog');
  await expect(dialog).toContainText('Factory values, never verified.');
  const back = dialog.getByRole('table', { name: 'Values before and after the rollback' });
  await expect(back.getByRole('row').filter({ hasText: 'Steering offset' })).toContainText('0.000');
  await accessible(page);
});

test.describe('a viewer', () => {
  test.use({ as: 'viewer' });

  test('is not asked to decide', async ({ page }) => {
    const [first] = await waiting(page.request, 1);
    await page.goto('/');
    const row = page.getByRole('row').filter({ hasText: first?.robot ?? '' });
    await expect(row.getByText('Awaiting approval').last()).toBeVisible();
    await expect(page.getByRole('link', { name: /^Review proposal/ })).toHaveCount(0);
    await expect(page.getByText(/attention\./)).toBeVisible();
    await page.goto(`/robots/${first?.robot}`);
    await expect(page.getByRole('link', { name: 'Show proposal' })).toBeVisible();
  });
});
