import { once } from 'node:events';
import { readFile } from 'node:fs/promises';
import { createServer, type IncomingMessage } from 'node:http';
import type { AddressInfo } from 'node:net';
import { PROPOSED_WITHIN_MS, waiting } from './decisions';
import { accessible, expect, test } from './fixtures';

test.use({ as: 'admin' });

test('an alert is taken on, with who, when and what for', async ({ page }) => {
  test.setTimeout(PROPOSED_WITHIN_MS);
  await page.goto('/alerts');
  const open = page.getByRole('listitem').filter({ hasText: 'Unacknowledged' });
  // By the name that the fleet has for it: nothing was applied yet that could have drifted.
  await expect(open.first()).toContainText('Needs calibration', { timeout: 60_000 });
  const robot = (await open.first().getByRole('link').first().innerText()).trim();
  // Alerts that come meanwhile stand before it: from here on it is known by its robot.
  await open.getByRole('button', { name: `Acknowledge the alert of ${robot}` }).click();
  await page.getByRole('dialog').getByLabel('Note').fill('Look at its mount');
  await page.getByRole('dialog').getByRole('button', { name: 'Acknowledge' }).click();
  const taken = page.getByRole('listitem').filter({ hasText: 'Look at its mount' });
  await expect(taken.first()).toContainText(/Acknowledged by admin, (yesterday )?\d\d:\d\d/);
  await taken.first().getByText('History').click();
  await expect(taken.first()).toContainText(/pending: .*acknowledged by admin/i);
  await accessible(page);
});

test('the audit is filtered in the address and comes as a file', async ({ page }) => {
  await page.goto('/audit');
  const rows = page.getByRole('row').filter({ hasText: 'What changed' });
  await expect(rows.filter({ hasText: 'session.sign_in' }).first()).toBeVisible();
  await page.getByLabel('Action').fill('session.sign_in');
  await page.getByLabel('Action').press('Enter');
  await expect(page).toHaveURL(/action=session.sign_in/);
  await expect(rows.filter({ hasText: 'user.create' })).toHaveCount(0);
  await expect(rows.first()).toContainText('session.sign_in');
  await rows.first().getByText('What changed').click();
  await expect(rows.first()).toContainText('role');
  await accessible(page);

  for (const [format, first] of [
    ['CSV', /^id,time,actor,/],
    ['NDJSON', /^\{"id":/],
  ] as const) {
    const download = page.waitForEvent('download');
    await page.getByRole('link', { name: `Download ${format}`, exact: true }).click();
    const text = await readFile(await (await download).path(), 'utf8');
    expect(text).toMatch(first);
    expect(text).toContain('session.sign_in');
    expect(text).not.toContain('user.create');
  }
});

test('Back finds the audit where it was left', async ({ page }) => {
  await page.setViewportSize({ width: 1440, height: 420 });
  await page.goto('/audit');
  const links = page.getByRole('row').filter({ hasText: 'What changed' }).getByRole('link');
  await expect(links.first()).toBeVisible();
  // Not every row has a link: the last one that has is brought into view, and pressed as it is.
  await links.last().evaluate((link) => link.scrollIntoView({ block: 'center' }));
  await page.waitForTimeout(300);
  const top = await page.evaluate(() => scrollY);
  expect(top).toBeGreaterThan(300);
  await links.last().evaluate((link) => (link as HTMLElement).click());
  await expect(page).toHaveURL(/\/robots\//);
  await expect.poll(() => page.evaluate(() => scrollY)).toBe(0);
  await page.goBack();
  await expect(page).toHaveURL(/\/audit/);
  await expect.poll(() => page.evaluate(() => scrollY)).toBe(top);
  // Who comes by a link begins at the top.
  await page.getByRole('link', { name: 'Fleet', exact: true }).click();
  await page.getByRole('link', { name: 'Audit', exact: true }).click();
  await expect.poll(() => page.evaluate(() => scrollY)).toBe(0);
});

test('tolerances are changed with a reason, and go back to the file', async ({ page, account }) => {
  await page.goto('/settings');
  const row = page.getByRole('row').filter({ hasText: 'Verification tolerance' });
  await expect(row).toContainText('0.15°');
  await page.getByRole('button', { name: 'Change', exact: true }).click();
  const steering = page.getByLabel('Verification tolerance: Steering, °');
  await steering.fill('a little');
  await page.getByRole('button', { name: 'Save' }).press('Enter');
  await expect(page.getByRole('alert').filter({ hasText: 'is not a number' })).toBeVisible();
  await expect(steering).toBeFocused();
  await accessible(page);
  await steering.fill('0,25');
  await steering.press('Enter');
  const dialog = page.getByRole('dialog');
  await dialog.getByLabel('Why').fill('Narrow aisles');
  await accessible(page);
  await dialog.getByRole('button', { name: 'Save changes' }).click();
  await expect(row).toContainText('0.25°');
  await expect(page.getByText(/Set here by admin, .*: Narrow aisles/)).toBeVisible();
  await page.goto('/audit?action=policy.change');
  await expect(page.getByRole('row').filter({ hasText: 'Narrow aisles' })).toContainText('admin');

  // What the service refuses is told where it is decided.
  await page.goto('/settings');
  await page.getByRole('button', { name: 'Change', exact: true }).click();
  await page.getByLabel('Verified after driving, m').fill('0');
  await page.getByRole('button', { name: 'Save' }).click();
  await dialog.getByLabel('Why').fill('None needed');
  await dialog.getByRole('button', { name: 'Save changes' }).click();
  await expect(dialog.getByRole('alert')).toContainText('verify_after_m: got 0');
  account.forgive(/status of 400/);
  await dialog.getByRole('button', { name: 'Cancel' }).click();
  await page.getByRole('button', { name: 'Cancel' }).click();

  await page.getByRole('button', { name: 'Reset to file' }).click();
  await dialog.getByLabel('Why').fill('As agreed');
  await dialog.getByRole('button', { name: 'Reset' }).click();
  await expect(row).toContainText('0.15°');
});

test('a user is made, changed and removed', async ({ page }) => {
  await page.goto('/settings/users');
  const row = page.getByRole('row').filter({ hasText: 'zoe_17' });
  await page.getByLabel('Name').fill('zoe_17');
  await page.getByLabel('First password').fill('too short');
  await page.getByRole('button', { name: 'Create user' }).click();
  await expect(page.getByRole('alert').filter({ hasText: '(now 9)' })).toBeVisible();
  await page.getByLabel('First password').fill('long enough for all');
  await page.getByRole('button', { name: 'Create user' }).click();
  await expect(page.getByText('zoe_17 can sign in now.')).toBeVisible();
  // An arrow key picks a role; only what is confirmed changes it.
  const role = page.getByLabel('Role of zoe_17');
  await role.focus();
  await role.press('ArrowDown');
  await expect(role).toHaveValue('operator');
  await page.reload();
  await expect(role).toHaveValue('viewer');
  await role.selectOption('operator');
  await row.getByRole('button', { name: 'Change role of zoe_17' }).click();
  const dialog = page.getByRole('dialog', { name: 'Change the role of zoe_17' });
  await expect(dialog).toContainText('From viewer to operator.');
  await accessible(page);
  await dialog.getByRole('button', { name: 'Change role' }).click();
  await expect(dialog).toBeHidden();
  await page.reload();
  await expect(role).toHaveValue('operator');
  await row.getByRole('button', { name: 'Disable zoe_17' }).click();
  await expect(row).toContainText('disabled');
  await accessible(page);
  await row.getByRole('button', { name: 'Remove zoe_17' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Remove' }).click();
  await expect(row).toHaveCount(0);
});

test('a token is shown once, counts, and is revoked', async ({ page, playwright, service }) => {
  await page.goto('/settings/tokens');
  await page.getByLabel('Name').fill('wall display');
  await page.getByRole('button', { name: 'Create token' }).click();
  const secret = page.getByText(/^cal_\S+$/);
  const value = await secret.innerText();
  await accessible(page);
  const tool = await playwright.request.newContext({
    baseURL: service.url,
    extraHTTPHeaders: { authorization: `Bearer ${value}` },
  });
  expect((await tool.get('/api/v1/robots')).status()).toBe(200);
  await page.reload();
  const row = page.getByRole('row').filter({ hasText: 'wall display' });
  await expect(row).toContainText('Valid');
  await expect(secret).toHaveCount(0);
  await row.getByRole('button', { name: 'Revoke wall display' }).click();
  await page.getByRole('dialog').getByRole('button', { name: 'Revoke' }).click();
  await expect(row).toContainText('Revoked');
  expect((await tool.get('/api/v1/robots')).status()).toBe(401);
  await tool.dispose();
});

test('a webhook is told, and its log says so', async ({ page }) => {
  test.setTimeout(PROPOSED_WITHIN_MS + 60_000);
  const told: IncomingMessage['headers'][] = [];
  const receiver = createServer((request, response) => {
    told.push(request.headers);
    request.resume();
    response.end();
  }).listen(0, '127.0.0.1');
  await once(receiver, 'listening');
  const { port } = receiver.address() as AddressInfo;
  const url = `http://127.0.0.1:${port}/hook`;
  try {
    await page.goto('/settings/webhooks');
    await page.getByLabel('Address').fill(url);
    await page.getByRole('button', { name: 'Create webhook' }).click();
    await expect(page.getByText(/^whsec_\S+$/)).toBeVisible();
    await page.getByRole('button', { name: 'Done' }).click();
    const [first] = await waiting(page.request, 1);
    const made = await page.request.post('/api/v1/proposals', {
      headers: { 'idempotency-key': 'webhook-test' },
      data: { robot: first?.robot, reason: 'to see whether it is told' },
    });
    expect(made.status()).toBe(201);
    await expect.poll(() => told.length, { timeout: 20_000 }).toBeGreaterThan(0);
    expect(told[0]?.['webhook-signature']).toMatch(/^v1,/);
    const hook = page.getByRole('heading', { name: url }).locator('..').locator('..');
    await hook.getByText('Deliveries').click();
    await expect(
      hook.getByRole('row').filter({ hasText: 'proposals that wait' }).first(),
    ).toContainText(/Delivered.*200/);
    await accessible(page);
    await hook.getByRole('button', { name: `Remove ${url}` }).click();
    await page.getByRole('dialog').getByRole('button', { name: 'Remove' }).click();
    await expect(page.getByText('No webhooks.')).toBeVisible();
  } finally {
    receiver.close();
  }
});

test('the service says how it is', async ({ page }) => {
  await page.goto('/health');
  await expect(page.getByText('Service healthy')).toBeVisible();
  const fact = (term: string) => page.locator('dl > div').filter({ hasText: term });
  await expect(fact('Zenoh session is open')).toContainText('yes');
  await expect(fact('Messages received')).toContainText(/\d+ a second/, { timeout: 15_000 });
  await expect(fact('Rows lost by the database')).toContainText('0');
  await expect(fact('Memory')).toContainText(/\d+ MiB/);
});
