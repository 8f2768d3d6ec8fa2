import { ADMIN } from './binary';
import { accessible, expect, test } from './fixtures';

test.use({ command: 'unset', as: null });

/** Message of a browser about an answer that asks to sign in. */
const ASKED = /status of 401/;

test('the first administrator is made by the printed link, once, by keyboard alone', async ({
  page,
  service,
  account,
}) => {
  const link = await service.setupLink();
  await page.goto('/');
  await expect(page.getByRole('heading', { name: 'No accounts yet' })).toBeVisible();
  await accessible(page);

  await page.goto(link);
  await expect(page.getByRole('heading', { name: 'Set up fleetcal' })).toBeVisible();
  await accessible(page);
  await page.getByLabel('Your name').fill(ADMIN.name);
  await page.getByLabel('New password', { exact: true }).fill('short');
  await page.getByLabel('Confirm new password').fill('short');
  await page.getByLabel('Confirm new password').press('Enter');
  await expect(page.getByRole('alert').filter({ hasText: '(now 5)' })).toBeVisible();
  await page.getByLabel('New password', { exact: true }).fill(ADMIN.password);
  await page.getByLabel('Confirm new password').fill(ADMIN.password);
  await page.getByLabel('Confirm new password').press('Enter');
  await expect(page.getByRole('heading', { name: 'No robot has sent anything yet' })).toBeVisible();
  await expect(page).toHaveURL(service.url + '/');
  await expect(page.getByRole('banner')).toContainText(`${ADMIN.name} admin`);

  await page.goto(link);
  await expect(page.getByRole('heading', { name: 'This service is set up already' })).toBeVisible();
  account.forgive(ASKED);
});

test('one signs in where one was, and out again', async ({ page, account }) => {
  await page.goto('/robots/no_such_robot');
  await expect(page.getByRole('heading', { name: 'Sign in' })).toBeVisible();
  await page.getByLabel('Name').fill(ADMIN.name);
  await page.getByLabel('Password').fill('wrong horse battery');
  await page.getByLabel('Password').press('Enter');
  await expect(page.getByRole('alert').filter({ hasText: 'is wrong' })).toBeVisible();
  await accessible(page);
  await page.getByLabel('Password').fill(ADMIN.password);
  await page.getByLabel('Password').press('Enter');
  await expect(page.getByRole('heading', { name: 'No robot has this name' })).toBeVisible();
  await expect(page).toHaveURL(/no_such_robot$/);
  await page.getByRole('banner').getByRole('button', { name: 'Sign out' }).click();
  await expect(page.getByRole('heading', { name: 'Sign in' })).toBeVisible();
  await expect(page.getByText('Your session has expired')).toBeHidden();
  account.forgive(ASKED);
  account.forgive(/status of 404/);
});

test('a session that ends under the hands leads to signing in and back', async ({
  page,
  context,
  account,
}) => {
  await page.goto('/account');
  await page.getByLabel('Name').fill(ADMIN.name);
  await page.getByLabel('Password').fill(ADMIN.password);
  await page.getByLabel('Password').press('Enter');
  await expect(page.getByRole('heading', { name: ADMIN.name })).toBeVisible();
  await accessible(page);
  await context.clearCookies();
  await page.getByLabel('Current password').fill(ADMIN.password);
  await page.getByLabel('New password', { exact: true }).fill('another horse battery');
  await page.getByLabel('Confirm new password').fill('another horse battery');
  await page.getByRole('button', { name: 'Change password' }).click();
  await expect(page.getByText('Your session has expired')).toBeVisible();
  await page.getByLabel('Name').fill(ADMIN.name);
  await page.getByLabel('Password').fill(ADMIN.password);
  await page.getByLabel('Password').press('Enter');
  await expect(page).toHaveURL(/\/account$/);

  await page.getByLabel('Current password').fill(ADMIN.password);
  await page.getByLabel('New password', { exact: true }).fill('another horse battery');
  await page.getByLabel('Confirm new password').fill('another horse battery');
  await page.getByRole('button', { name: 'Change password' }).click();
  await expect(page.getByText('The password is changed')).toBeVisible();
  account.forgive(ASKED);
});

test('edits of the policy outlive a link and a session that ends', async ({
  page,
  context,
  account,
}) => {
  const signIn = async () => {
    await page.getByLabel('Name').fill(ADMIN.name);
    await page.getByLabel('Password').fill('another horse battery');
    await page.getByLabel('Password').press('Enter');
  };
  await page.goto('/settings');
  await signIn();
  await page.getByRole('button', { name: 'Change', exact: true }).click();
  const steering = page.getByLabel('Verification tolerance: Steering, °');
  await steering.fill('0.25');
  await page.getByRole('link', { name: 'Health' }).click();
  await expect(page.getByRole('heading', { level: 1, name: 'Health' })).toBeVisible();
  await page.getByRole('link', { name: 'Settings' }).click();
  await expect(steering).toHaveValue('0.25');

  await context.clearCookies();
  await page.getByRole('button', { name: 'Save' }).click();
  const dialog = page.getByRole('dialog');
  await dialog.getByLabel('Why').fill('Narrow aisles');
  await dialog.getByRole('button', { name: 'Save changes' }).click();
  await expect(page.getByRole('heading', { name: 'Sign in' })).toBeVisible();
  await signIn();
  await expect(steering).toHaveValue('0.25');
  await page.getByRole('button', { name: 'Save' }).click();
  await expect(dialog.getByLabel('Why')).toHaveValue('Narrow aisles');
  await dialog.getByRole('button', { name: 'Save changes' }).click();
  await expect(page.getByRole('row').filter({ hasText: 'Verification tolerance' })).toContainText(
    '0.25°',
  );
  // Cancelled edits are gone.
  await page.getByRole('button', { name: 'Change', exact: true }).click();
  await steering.fill('0.5');
  await page.getByRole('button', { name: 'Cancel' }).click();
  await page.getByRole('button', { name: 'Change', exact: true }).click();
  await expect(steering).toHaveValue('0.25');
  account.forgive(ASKED);
});

for (const colorScheme of ['light', 'dark'] as const) {
  test(`signing in is accessible, ${colorScheme}`, async ({ page, account }) => {
    await page.emulateMedia({ colorScheme });
    await page.goto('/');
    await expect(page.getByRole('heading', { name: 'Sign in' })).toBeVisible();
    await accessible(page);
    await page.setViewportSize({ width: 390, height: 844 });
    await accessible(page);
    account.forgive(ASKED);
  });
}
