import { ADMIN } from './binary';
import { accessible, expect, test } from './fixtures';

test.use({ command: 'unset', as: null });

/** What a browser says of an answer that asks to sign in. */
const ASKED = /status of 401/;

test('the first administrator is made by the printed link, once, by keyboard alone', async ({
  page,
  service,
  account,
}) => {
  const link = await service.setupLink();
  await page.goto('/');
  await expect(page.getByRole('heading', { name: 'Nobody has an account yet' })).toBeVisible();
  await accessible(page);

  await page.goto(link);
  await expect(page.getByRole('heading', { name: 'Set up fleetcal' })).toBeVisible();
  await accessible(page);
  await page.getByLabel('Your name').fill(ADMIN.name);
  await page.getByLabel('New password', { exact: true }).fill('short');
  await page.getByLabel('New password once more').fill('short');
  await page.getByLabel('New password once more').press('Enter');
  await expect(page.getByRole('alert').filter({ hasText: '5 characters' })).toBeVisible();
  await page.getByLabel('New password', { exact: true }).fill(ADMIN.password);
  await page.getByLabel('New password once more').fill(ADMIN.password);
  await page.getByLabel('New password once more').press('Enter');
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
  await expect(page.getByText('The session has ended')).toBeHidden();
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
  await page.getByLabel('New password once more').fill('another horse battery');
  await page.getByRole('button', { name: 'Change it' }).click();
  await expect(page.getByText('The session has ended')).toBeVisible();
  await page.getByLabel('Name').fill(ADMIN.name);
  await page.getByLabel('Password').fill(ADMIN.password);
  await page.getByLabel('Password').press('Enter');
  await expect(page).toHaveURL(/\/account$/);

  await page.getByLabel('Current password').fill(ADMIN.password);
  await page.getByLabel('New password', { exact: true }).fill('another horse battery');
  await page.getByLabel('New password once more').fill('another horse battery');
  await page.getByRole('button', { name: 'Change it' }).click();
  await expect(page.getByText('The password is changed')).toBeVisible();
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
