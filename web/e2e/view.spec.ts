import { accessible, expect, sideways, test } from './fixtures';

test.use({ command: 'serve', own: 'view', as: 'admin' });

const ROBOTS: Record<string, object> = {
  agv_1: { model: 'tricycle', wheelbase_m: 1.5, site: 'Hamburg', tags: ['night shift'] },
  agv_2: { model: 'bicycle', wheelbase_m: 1.2, site: 'Hamburg', vehicle_type: 'EKX 516' },
  agv_10: { model: 'tricycle', wheelbase_m: 1.5, site: 'Hamburg' },
  tug_1: { model: 'tricycle', wheelbase_m: 1.5, site: 'Munich' },
};

test('a view of the fleet stands in its address', async ({ page, account }) => {
  for (const [id, data] of Object.entries(ROBOTS)) {
    const headers = { 'if-none-match': '*' };
    const made = await page.request.put(`/api/v1/robots/${id}`, { headers, data });
    expect(made.status()).toBe(201);
  }
  const rows = page.getByRole('row').filter({ has: page.getByRole('rowheader') });
  const names = async () =>
    (await rows.getByRole('rowheader').getByRole('link').allInnerTexts()).map((one) => one.trim());

  // The groups of all robots, and what differs: nothing is known yet.
  await page.goto('/');
  const common = page.locator('section').filter({
    has: page.getByRole('heading', { name: 'What robots have in common' }),
  });
  await expect(common).toContainText('No site or tag differs');
  await common.getByText('Values by group').click();
  await expect(common.getByRole('row', { name: /^tricycle 3 0 0 not known/ })).toBeVisible();
  await common.getByLabel('Group by').selectOption('Site');
  await expect(common.getByRole('row', { name: /^Hamburg 3/ })).toBeVisible();
  await accessible(page);
  await common.getByRole('link', { name: 'Hamburg' }).click();
  await expect(page).toHaveURL(/\?q=site%3A%22Hamburg%22$/);
  await expect.poll(names).toEqual(['agv_1', 'agv_2', 'agv_10']);

  await page.goto('/?q=site:hamburg+model:tricycle');
  await expect.poll(names).toEqual(['agv_1', 'agv_10']);
  await expect(page.getByText('2 of 4 robots found.')).toBeVisible();
  await expect(page.getByRole('link', { name: 'All 2' })).toBeVisible();
  // Never heard is a fact of its own, beside the state.
  await expect(rows.first().locator('.state')).toContainText('No data yet');
  await expect(rows.first().getByText('Silent', { exact: true })).toBeVisible();
  await page.reload();
  await expect.poll(names).toEqual(['agv_1', 'agv_10']);

  const query = page.getByRole('searchbox', { name: 'Find robots by name or property' });
  await expect(query).toHaveValue('site:hamburg model:tricycle');
  await query.fill('AGV');
  await expect.poll(names).toEqual(['agv_1', 'agv_2', 'agv_10']);
  const order = page.getByRole('combobox', { name: 'Order of the robots' });
  await order.selectOption('By vehicle type');
  await expect.poll(names).toEqual(['agv_2', 'agv_1', 'agv_10']);
  await expect(page).toHaveURL(/\?q=AGV&sort=type$/);

  // A query that is not understood says where, and what was found before stays.
  await query.fill('AGV modle:tricycle');
  await expect(page.getByText('Q: got "modle" at character 5, expected one of id:')).toBeVisible();
  await expect.poll(names).toEqual(['agv_2', 'agv_1', 'agv_10']);
  await accessible(page);
  await query.fill('tag:"night shift"');
  await expect.poll(names).toEqual(['agv_1']);
  await expect(page.getByText('Q: got')).toHaveCount(0);

  const saved = page.waitForEvent('download');
  await page.getByRole('link', { name: 'List as CSV' }).click();
  expect((await saved).suggestedFilename()).toBe('robots.csv');

  // A robot in maintenance is found as that, with end, reason and person.
  const until = new Date(Date.now() + 3_600_000).toISOString();
  const data = { until, reason: 'new tyres' };
  const parked = await page.request.put('/api/v1/robots/tug_1/maintenance', { data });
  expect(parked.status()).toBe(200);
  await page.goto('/?q=connection:maintenance');
  await expect.poll(names).toEqual(['tug_1']);
  await expect(rows.getByText(/^In maintenance until .+: new tyres \(ada\)$/)).toBeVisible();

  // The group of a robot leads to the others of it.
  await page.goto('/robots/agv_2');
  await page.getByRole('link', { name: 'EKX 516' }).click();
  await expect.poll(names).toEqual(['agv_2']);

  await page.setViewportSize({ width: 320, height: 640 });
  await page.goto('/?q=site:hamburg&sort=-deviation');
  await expect(page.getByRole('link', { name: 'agv_10' })).toBeVisible();
  await page.getByText('What can be asked').click();
  await expect(page.getByText('deviation>1', { exact: true })).toBeVisible();
  expect(await sideways(page)).toBe(0);
  await accessible(page);
  account.forgive(/status of 400/);
});

test('a common cause is said with the robots that share it, and a robot unlike its type', async ({
  page,
}) => {
  // Forty robots with converged values take too long here: what the service would name is given.
  await page.route(/\/api\/v1\/fleet\/statistics\b/, async (route) => {
    const response = await route.fetch();
    const jig = ['agv_1', 'agv_2', 'agv_10'];
    const shifts = [{ parameter: 'lidar_yaw', shift: 0.015, probability: 1e-7 }];
    const cause = { kind: 'EKX 516', by: 'tag', group: 'jig 3', robots: jig, others: 28, shifts };
    const unlike = { robot: 'tug_1', kind: 'EKX 516', others: 30, parameter: 'lidar_x' };
    const json = {
      ...((await response.json()) as object),
      common_causes: [cause],
      unlike: [{ ...unlike, difference: -0.0754, spread: 0.004 }],
    };
    await route.fulfill({ response, json });
  });
  await page.goto('/');
  const said = page.locator('section').filter({
    has: page.getByRole('heading', { name: 'What robots have in common' }),
  });
  await expect(said.getByRole('listitem').first()).toHaveText(
    '3 of 31 EKX 516 share the tag jig 3 and differ from the others: LiDAR yaw +0.859°.',
  );
  await expect(said.getByRole('listitem').last()).toHaveText(
    'tug_1 is unlike 30 others of EKX 516: LiDAR x −75.4 mm, where they spread by ±4.0 mm.',
  );
  await said.getByRole('link', { name: 'jig 3' }).click();
  await expect(page).toHaveURL(/\?q=tag%3A%22jig%203%22$/);
  await accessible(page);
});
