/** Requests of life-cycle tests to the service beside the browser. */

import { expect, type APIRequestContext, type Browser, type Page } from '@playwright/test';
import type { Service } from './binary';

/** The demo's robots are known, and something is proposed for each, this long after its start. */
export const PROPOSED_WITHIN_MS = 120_000;
/** The robots of the demo. */
export const DEMO_ROBOTS = 6;

export interface Proposal {
  id: number;
  robot: string;
  version: number;
  state: string;
  outdated?: string | null;
  revision: { sha256: string; values: Partial<Record<string, number | null>> };
}

/** The proposals that wait for a decision that can be either, once there are `least` of them. */
export async function waiting(request: APIRequestContext, least: number): Promise<Proposal[]> {
  let items: Proposal[] = [];
  await expect
    .poll(
      async () => {
        const answer = await request.get('/api/v1/proposals?state=proposed&limit=100');
        const page = (await answer.json()) as { items: Proposal[] };
        // Nobody approves what is outdated: the estimate has moved on since.
        items = page.items.filter((one) => !one.outdated);
        return items.length;
      },
      { timeout: PROPOSED_WITHIN_MS },
    )
    .toBeGreaterThanOrEqual(least);
  return items;
}

/** A proposal as it stands now. */
export async function proposal(request: APIRequestContext, id: number): Promise<Proposal> {
  const answer = await request.get(`/api/v1/proposals/${id}`);
  return (await answer.json()) as Proposal;
}

/** A second person's browser at the same service. */
export async function another(browser: Browser, service: Service, name: string): Promise<Page> {
  const storageState = await service.signedIn(name);
  const context = await browser.newContext({ baseURL: service.url, storageState });
  return context.newPage();
}

/** Presses Tab until `wanted` has the focus: what a mouse can reach, keys must reach too. */
export async function tabTo(page: Page, role: 'link' | 'button', name: string | RegExp) {
  const wanted = page.getByRole(role, { name }).first();
  await expect(wanted).toBeVisible();
  for (let presses = 0; presses < 80; presses++) {
    if (await wanted.evaluate((element) => element === document.activeElement)) return;
    await page.keyboard.press('Tab');
  }
  throw new Error(`80 presses of Tab did not reach the ${role} ${name}`);
}
