import { readFile } from 'node:fs/promises';
import { letters } from './canvas';
import { accessible, expect, legible, openPart, sideways, test } from './fixtures';

/** Charts of NIS and of the three innovations. */
const OF_CONSISTENCY = 4;
const CHARTS = ['Steering offset', 'LiDAR x', 'LiDAR y', 'LiDAR yaw'];

test.beforeEach(async ({ page }) => {
  await page.goto('/');
  await page.getByRole('rowheader').first().getByRole('link').click();
  await openPart(page, 'History');
  await expect(page.getByRole('figure')).toHaveCount(CHARTS.length + OF_CONSISTENCY);
});

test('it answers first: verdict, next step, deviation and gain, then parts with addresses', async ({
  page,
}) => {
  const robot = new URL(page.url()).pathname;
  await page.goto(robot);
  const answers = page.locator('.hero dl');
  for (const what of ['Next step', 'Deviation, in tolerances', 'Off its path (RMS)']) {
    await expect(answers.getByText(what, { exact: true })).toBeInViewport();
  }
  await expect(answers.getByText(/\d+\.\d mm/)).toBeInViewport({ timeout: 90_000 });
  await expect(
    page.getByRole('img', { name: /^Histogram of cross-track errors/ }),
  ).toBeInViewport();
  await expect(page.getByRole('figure')).toHaveCount(0);
  for (const [part, heading] of [
    ['Evidence', 'Top view'],
    ['History', 'Deployments'],
    ['Raw', 'Diagnostics'],
    ['Overview', 'Calibration in use'],
  ] as const) {
    await openPart(page, part);
    await expect(page.getByRole('heading', { name: heading, exact: true })).toBeVisible();
    await page.reload();
    await expect(page.getByRole('heading', { name: heading, exact: true })).toBeVisible();
  }
});

test('the joining check says of a sound robot that nothing is wrong, with its streams', async ({
  page,
}) => {
  await openPart(page, 'Evidence');
  const card = page
    .locator('section')
    .filter({ has: page.getByRole('heading', { name: 'Joining check' }) });
  await expect(card.getByText(/^Nothing is wrong/)).toBeVisible();
  await expect(card.getByRole('list', { name: 'Checks' }).getByRole('listitem')).not.toHaveCount(0);
  await expect(card.getByText('Wrong', { exact: true })).toHaveCount(0);
  const streams = card.getByRole('region', { name: 'Streams as they come' });
  await expect(streams.getByRole('rowheader', { name: 'wheel odometry' })).toBeVisible();
  await expect(streams.getByRole('rowheader', { name: 'scan' })).toBeVisible();
});

test('times are said as people say them, with the rest as a tooltip', async ({ page }) => {
  await openPart(page, 'Overview');
  const time = page.getByRole('listitem').locator('time').first();
  await expect(time).toHaveText(/^(yesterday )?\d\d:\d\d$/);
  await expect(time).toHaveAttribute('title', /\d{4}.*\d\d:\d\d:\d\d \S+/);
});

test('four charts have data, and the same numbers as a table', async ({ page }) => {
  for (const label of CHARTS) {
    const figure = page
      .getByRole('figure')
      .filter({ has: page.getByRole('heading', { name: new RegExp(`^${label} `) }) });
    const slider = figure.getByRole('slider');
    // Points come once a second.
    await expect
      .poll(async () => Number(await slider.getAttribute('aria-valuemax')), { timeout: 30_000 })
      .toBeGreaterThan(8);
    const painted = await figure.locator('canvas').evaluate((canvas: HTMLCanvasElement) => {
      const data = canvas.getContext('2d')?.getImageData(0, 0, canvas.width, canvas.height).data;
      return data ? data.filter((value, i) => i % 4 === 3 && value > 0).length : 0;
    });
    expect(painted).toBeGreaterThan(1000);
    await figure.getByRole('button', { name: /^Show as table/ }).click();
    const rows = figure.getByRole('row');
    expect(await rows.count()).toBeGreaterThan(8);
    await expect(rows.nth(1)).toContainText(/\d{4}, \d\d:\d\d:\d\d \S+.*\d/);
    await figure.getByRole('button', { name: /^Show as table/ }).click();
    await expect(slider).toBeVisible();
  }
});

test('the axes have letters of 12 px at every pixel ratio, and none is cut off', async ({
  page,
  browser,
  service,
}) => {
  const robot = new URL(page.url()).pathname;
  for (const ratio of [1, 2, 3]) {
    const context = await browser.newContext({
      baseURL: service.url,
      storageState: await service.signedIn('operator'),
      deviceScaleFactor: ratio,
      viewport: ratio === 1 ? { width: 1440, height: 900 } : { width: 390, height: 844 },
    });
    const screen = await context.newPage();
    const drawn = await letters(screen);
    await screen.goto(`${robot}?show=history`);
    await expect(screen.getByRole('figure')).toHaveCount(CHARTS.length + OF_CONSISTENCY);
    await expect
      .poll(async () => (await drawn()).filter(({ text }) => /^\d\d:\d\d/.test(text)).length)
      .toBeGreaterThan(CHARTS.length);
    for (const { text, size_px, right_px, width_px } of await drawn()) {
      expect(size_px, `${text} at ratio ${ratio}`).toBe(12);
      expect(right_px, `${text} at ratio ${ratio}`).toBeLessThanOrEqual(width_px);
    }
    await context.close();
  }
});

test('it says what the robot should drive next, and nothing that would tell nothing', async ({
  page,
}) => {
  await openPart(page, 'Overview');
  const panel = page.locator('section').filter({
    has: page.getByRole('heading', { name: 'Recommended manoeuvres' }),
  });
  await expect(panel).toContainText(/Ranked by|no manoeuvre would add|No single manoeuvre/);
  const all = panel.getByRole('button', { name: /^Show all \d+/ });
  if (await all.isVisible()) await all.click();
  const rows = panel.getByRole('row').filter({ has: page.getByRole('rowheader') });
  for (const row of await rows.all()) {
    await expect(row).toContainText(/\d+ m?.*× \d/);
    await expect(row.getByRole('cell').last()).not.toHaveText(/^(0\.0|0 %)$/);
  }
});

test('charts are live', async ({ page }) => {
  const slider = page.getByRole('slider').first();
  const points = async () => Number(await slider.getAttribute('aria-valuemax'));
  await expect.poll(points).toBeGreaterThan(1);
  const before = await points();
  await expect.poll(points, { timeout: 20_000 }).toBeGreaterThan(before + 2);
});

test('a chart is read with the keyboard alone', async ({ page }) => {
  const slider = page.getByRole('slider', { name: /^LiDAR x/ });
  await expect
    .poll(async () => Number(await slider.getAttribute('aria-valuemax')))
    .toBeGreaterThan(4);
  await slider.focus();
  await page.keyboard.press('Home');
  await expect(slider).toHaveAttribute('aria-valuenow', '0');
  const said = async () => (await slider.getAttribute('aria-valuetext')) ?? '';
  const texts = [await said()];
  expect(texts[0]).toMatch(/^\d\d:\d\d:\d\d \S+: .+ ± .+mm(, .+)?$/);
  for (const at of ['1', '2']) {
    await page.keyboard.press('ArrowRight');
    await expect(slider).toHaveAttribute('aria-valuenow', at);
    texts.push(await said());
  }
  // What happened there is named, and the cursor stays at its time while the chart moves on.
  expect(texts.join('; ')).toContain('New session');
  const points = Number(await slider.getAttribute('aria-valuemax'));
  await expect
    .poll(async () => Number(await slider.getAttribute('aria-valuemax')))
    .toBeGreaterThan(points + 3);
  expect(await said()).toBe(texts.at(-1));
  await page.keyboard.press('Escape');
  await expect(slider).toHaveAttribute('aria-valuetext', /^now: /);
  // No other chart brings the cursor back when it moves on.
  const left = Number(await slider.getAttribute('aria-valuemax'));
  await expect
    .poll(async () => Number(await slider.getAttribute('aria-valuemax')))
    .toBeGreaterThan(left + 2);
  expect(await said()).toMatch(/^now: /);
});

test('a chart gives its numbers as CSV', async ({ page }) => {
  const slider = page.getByRole('slider', { name: /^LiDAR yaw/ });
  await expect
    .poll(async () => Number(await slider.getAttribute('aria-valuemax')))
    .toBeGreaterThan(4);
  const download = page.waitForEvent('download');
  await page.getByRole('button', { name: 'Download CSV: LiDAR yaw' }).click();
  const file = await download;
  expect(file.suggestedFilename()).toMatch(/^\S+_lidar_yaw\.csv$/);
  const [head, first] = (await readFile(await file.path(), 'utf8')).split('\r\n');
  expect(head).toContain('time_utc,lidar_yaw_rad,lidar_yaw_sigma_rad');
  expect(first).toMatch(/^\d{4}-\d\d-\d\dT[\d:.]+Z,-?[\d.e-]+,[\d.e-]+,/);
});

test('a stretch cut out of a chart stands in the address, and the way back is there', async ({
  page,
}) => {
  const chart = page.getByRole('slider').first();
  await expect
    .poll(async () => Number(await chart.getAttribute('aria-valuemax')))
    .toBeGreaterThan(8);
  const box = await chart.boundingBox();
  if (!box) throw new Error('the chart has no place on the page');
  await page.mouse.move(box.x + box.width * 0.5, box.y + 80);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width * 0.9, box.y + 90, { steps: 5 });
  await page.mouse.up();
  await expect(page).toHaveURL(/from=.+&to=/);
  await page.getByRole('link', { name: 'Back to the last hour' }).click();
  await expect(page).toHaveURL(/range=1h/);
  // The chart itself has a way back too.
  await page.goBack();
  await expect(page).toHaveURL(/from=.+&to=/);
  await chart.dblclick({ position: { x: 200, y: 80 } });
  await expect(page).not.toHaveURL(/from=/);
});

test('a reassembly is reported and stands among what happened', async ({ page }) => {
  test.setTimeout(180_000);
  await page.getByRole('button', { name: 'Report reassembly…' }).click();
  const dialog = page.getByRole('dialog');
  await accessible(page);
  const note = 'New bracket <img src=x onerror=alert(1)>';
  await dialog.getByLabel('What was done').fill(note);
  await dialog.getByRole('button', { name: 'Report', exact: true }).click();
  await expect(dialog).toBeHidden();
  await expect(page.getByRole('listitem').filter({ hasText: note })).toContainText('operator');
  await openPart(page, 'Overview');
  // Its verdict stands at the top: open, until the robot has driven.
  const verdict = page.locator('section').filter({
    has: page.getByRole('heading', { name: 'After the reassembly' }),
  });
  await expect(verdict).toContainText(note);
  await expect(verdict).toContainText(/Not known yet|Unchanged|Changed/);
  await accessible(page);
});

for (const [colorScheme, checked] of [
  ['light', accessible],
  ['dark', legible],
] as const) {
  test(`a robot's page is accessible, ${colorScheme}`, async ({ page }) => {
    // The tables have a row for each second: three times all of that takes its time.
    test.setTimeout(180_000);
    await page.emulateMedia({ colorScheme });
    for (const part of ['Overview', 'Evidence', 'History', 'Raw'] as const) {
      await page.setViewportSize({ width: 1440, height: 900 });
      await openPart(page, part);
      await test.step(`${part} wide`, () => checked(page));
      for (const button of await page.getByRole('button', { name: /^Show as table/ }).all()) {
        if ((await button.getAttribute('aria-pressed')) === 'false') await button.click();
      }
      await test.step(`${part} as tables`, () => checked(page));
      await page.setViewportSize({ width: 390, height: 844 });
      await test.step(`${part} on a phone`, () => checked(page));
      for (const width of [390, 320]) {
        await page.setViewportSize({ width, height: 640 });
        expect(await sideways(page), `${part} scrolls sideways at ${width} px`).toBe(0);
        // What a robot is judged by is seen without scrolling its table.
        const hidden = () =>
          page
            .getByRole('table', { name: /^Estimate with/ })
            .evaluateAll((tables) =>
              tables.map(({ scrollWidth, parentElement }) =>
                Math.max(0, scrollWidth - (parentElement?.clientWidth ?? 0)),
              ),
            );
        await expect
          .poll(hidden, `numbers cut off at ${width} px`)
          .toEqual(part === 'Overview' ? [0] : []);
      }
    }
  });
}

test('with reduced motion nothing moves, and without it a change takes 150 ms', async ({
  page,
}) => {
  await openPart(page, 'Overview');
  const bar = page.locator('.deviation .within').first();
  await expect(bar).toBeVisible({ timeout: 90_000 });
  const takes = () => bar.evaluate((element) => getComputedStyle(element).transitionDuration);
  expect(await takes()).toBe('0.15s');
  await page.emulateMedia({ reducedMotion: 'reduce' });
  expect(await takes()).toBe('0s');
  // The same of a state that changes.
  await page.evaluate(() => {
    const counted = Object.assign(globalThis, { moves: 0 });
    const { prototype } = Element;
    const animate = prototype.animate;
    prototype.animate = function (...how) {
      const options = how[1];
      if (typeof options === 'object' && Number(options.duration) > 0) counted.moves++;
      return animate.apply(this, how);
    };
  });
  const moves = () => page.evaluate(() => (globalThis as unknown as { moves: number }).moves);
  let standing = 'fault';
  await page.route(/\/api\/v1\/robots\/[^/]+$/, async (route) => {
    const response = await route.fetch();
    const robot = (await response.json()) as Record<string, unknown>;
    await route.fulfill({ response, json: { ...robot, standing } });
  });
  const shown = (word: string) => page.locator('.hero .state', { hasText: word });
  await expect(shown('Sensor fault')).toBeVisible({ timeout: 10_000 });
  expect(await moves()).toBe(0);
  await page.emulateMedia({ reducedMotion: 'no-preference' });
  standing = 'drift';
  await expect(shown('Drift')).toBeVisible({ timeout: 10_000 });
  expect(await moves()).toBeGreaterThan(0);
});

test('the colours can be chosen and are kept', async ({ page }) => {
  await page.emulateMedia({ colorScheme: 'light' });
  const background = () =>
    page.evaluate(() => getComputedStyle(document.documentElement).backgroundColor);
  const light = await background();
  const button = page.getByRole('button', { name: /^Colours/ });
  await button.click();
  await button.click();
  await expect(button).toHaveText(/Dark/);
  const dark = await background();
  expect(dark).not.toBe(light);
  await page.reload();
  expect(await background()).toBe(dark);
});

test('the robot has a top view: scan, map, and where each steering would have led it', async ({
  page,
}) => {
  test.setTimeout(180_000);
  await openPart(page, 'Evidence');
  const panel = page.locator('section').filter({
    has: page.getByRole('heading', { name: 'Top view' }),
  });
  await panel.scrollIntoViewIfNeeded();
  const drawing = panel.getByRole('img');
  // Trajectories follow the first guess.
  await expect(drawing).toHaveAttribute(
    'aria-label',
    /\d+ returns .* \d+ points .* raw steering ends \d+\.\d\d m .* corrected steering \d+\.\d\d m/,
    { timeout: 40_000 },
  );
  for (const what of ['latest scan', 'local map', 'driven, by LiDAR', 'by raw steering']) {
    await expect(panel.getByRole('listitem').filter({ hasText: what })).toBeVisible();
  }
  const scan = panel.locator('.drawing path.returns');
  expect(((await scan.getAttribute('d')) ?? '').split('M').length).toBeGreaterThan(100);

  // It is live.
  const before = await scan.getAttribute('d');
  await expect.poll(() => scan.getAttribute('d')).not.toBe(before);

  // By keyboard: closer, and the scale bar with it.
  const bar = panel.locator('.drawing text');
  await expect(bar).toHaveText('2 m');
  await panel.getByRole('button', { name: 'Zoom in' }).focus();
  await page.keyboard.press('Enter');
  await page.keyboard.press('Enter');
  await expect(bar).toHaveText('0.5 m');
  await expect(panel.getByRole('button', { name: 'Zoom in' })).toBeDisabled();

  await panel.getByRole('button', { name: 'Show as table: trajectories' }).press('Enter');
  expect(await panel.getByRole('row').count()).toBeGreaterThan(5);
  await expect(panel.getByRole('row').nth(1)).toContainText(/^0\.0/);
  await accessible(page);
  const download = page.waitForEvent('download');
  await panel.getByRole('button', { name: 'Download CSV: top view' }).press('Enter');
  const lines = (await readFile(await (await download).path(), 'utf8')).trimEnd().split('\r\n');
  expect(lines[0]).toBe('what,time_utc,x_m,y_m');
  const kinds = new Set(lines.slice(1).map((line) => line.split(',')[0]));
  expect([...kinds].toSorted()).toEqual([
    'lidar',
    'rear_axle_by_corrected_steering',
    'rear_axle_by_lidar',
    'rear_axle_by_raw_steering',
    'return',
    'surface',
  ]);
});
