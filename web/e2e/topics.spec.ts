import { accessible, expect, openPart, test, valueCharts } from './fixtures';

test.use({ command: 'serve', own: 'topics' });

test('a ROS 2 robot that announces its topics is given them, and is calibrated', async ({
  page,
  service,
}) => {
  await page.goto('/');
  service.simulateRos2('crane_01');
  const row = page.getByRole('row').filter({ hasText: 'crane_01' });
  await expect(row).toContainText('Not set up', { timeout: 40_000 });
  await row.getByRole('link', { name: 'Set up vehicle' }).click();
  await expect(page.getByText('Announces 4 topics: say what they carry.')).toBeVisible();
  await expect(page.getByText('not of use here: camera/image')).toBeVisible();

  await page.getByLabel('Speed and steering').selectOption({ label: 'on two topics' });
  await page
    .getByLabel('Steering angle')
    .selectOption({ label: 'joint_states (sensor_msgs/msg/JointState)' });
  await page
    .getByRole('combobox', { name: /^Speed(?! and)/ })
    .selectOption({ label: 'odom (nav_msgs/msg/Odometry)' });
  await expect(page.getByLabel('LiDAR')).toHaveValue('front/scan');
  await page.getByLabel('Wheelbase').fill('1.2');
  await page.getByRole('button', { name: 'Start calibration' }).click();
  await expect(page.getByText('Name the joint that steers.')).toBeVisible();
  await accessible(page);
  await page.getByLabel('Joint that steers').fill('steer');
  await page.getByRole('button', { name: 'Start calibration' }).click();

  await openPart(page, 'History');
  await expect(valueCharts(page)).toHaveCount(4);
  await expect(page.getByText('bicycle, wheelbase 1.200 m')).toBeVisible();
  // The first estimate comes within a minute of driving.
  const slider = page.getByRole('slider').first();
  await expect
    .poll(async () => Number(await slider.getAttribute('aria-valuemax')), { timeout: 50_000 })
    .toBeGreaterThan(2);
  const robot = await page.request.get('/api/v1/robots/crane_01');
  const { pairing, counters } = (await robot.json()) as {
    pairing: { paired: number };
    counters: { refused: number };
  };
  expect(pairing.paired).toBeGreaterThan(100);
  expect(counters.refused).toBe(0);
});
