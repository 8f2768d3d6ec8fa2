/** A browser page that keeps an account of everything a page of ours must not do. */

import AxeBuilder from '@axe-core/playwright';
import { expect, type Page, test as base } from '@playwright/test';
import { Service } from './binary';

/** Errors in the browser, besides those that a test expects. */
class Account {
  readonly #wrongs: string[] = [];
  readonly #origin: string;

  constructor(page: Page, origin: string) {
    this.#origin = origin;
    page.on('console', (message) => {
      if (message.type() === 'error') this.#wrongs.push(`console: ${message.text()}`);
    });
    page.on('pageerror', (error) => this.#wrongs.push(`error: ${error.message}`));
    page.on('request', (request) => {
      const { origin: to, protocol } = new URL(request.url());
      if (to !== this.#origin && protocol !== 'blob:') {
        this.#wrongs.push(`request elsewhere: ${request.url()}`);
      }
    });
  }

  /** Adds a report of the content security policy. */
  report(violation: string): void {
    this.#wrongs.push(`content security policy: ${violation}`);
  }

  /** Forgets complaints that a test has brought about itself, such as a service that is away. */
  forgive(pattern: RegExp): void {
    const kept = this.#wrongs.filter((wrong) => !pattern.test(wrong));
    this.#wrongs.splice(0, this.#wrongs.length, ...kept);
  }

  /** Errors so far. */
  get wrongs(): readonly string[] {
    return this.#wrongs;
  }
}

interface Given {
  account: Account;
  /** Account that is signed in: one of the demo's, or none. */
  as: string | null;
}

interface Shared {
  /**
   * Service that the tests of a file run against: the demo, a service without robots, or one that
   * nobody has set up.
   */
  command: 'demo' | 'serve' | 'unset';
  /** Tests that change what others look at have a service of their own, by this name. */
  own: string;
  /** Seconds that pass for a demo's robots in one of real time. */
  rate: number;
  service: Service;
}

export const test = base.extend<Given, Shared>({
  command: ['demo', { option: true, scope: 'worker' }],
  own: ['', { option: true, scope: 'worker' }],
  rate: [4, { option: true, scope: 'worker' }],

  service: [
    async ({ command, rate }, use) => {
      const service = await Service.start(command === 'demo' ? 'demo' : 'serve', rate);
      await use(service);
      await service.stop();
    },
    { scope: 'worker', timeout: 60_000 },
  ],

  as: ['operator', { option: true }],

  storageState: async ({ as, service }, use) => {
    await use(as === null ? { cookies: [], origins: [] } : await service.signedIn(as));
  },

  baseURL: async ({ service }, use) => use(service.url),

  account: [
    async ({ page, service }, use) => {
      const account = new Account(page, service.url);
      await page.exposeFunction('fleetcalReport', (violation: string) => account.report(violation));
      await page.addInitScript(() => {
        document.addEventListener('securitypolicyviolation', (event) => {
          const { violatedDirective, blockedURI, sourceFile, lineNumber } = event;
          const report = (globalThis as unknown as Record<string, (text: string) => void>)[
            'fleetcalReport'
          ];
          report?.(`${violatedDirective} ${blockedURI} ${sourceFile}:${lineNumber}`);
        });
      });
      await use(account);
      expect(account.wrongs).toEqual([]);
    },
    { auto: true },
  ],
});

/** The rules that a colour scheme decides; every other is the same in both. */
const OF_COLOURS = ['color-contrast', 'link-in-text-block'];

/** No violation of any accessibility rule, contrast included. */
export async function accessible(page: Page): Promise<void> {
  await none(new AxeBuilder({ page }));
}

/** No violation of the rules that the present colour scheme decides. */
export async function legible(page: Page): Promise<void> {
  await none(new AxeBuilder({ page }).withRules(OF_COLOURS));
}

/** Rows after the twelfth, which are made as those before: a table of seconds has hundreds. */
const FURTHER_ROWS = 'tbody > tr:nth-child(n + 13)';

async function none(axe: AxeBuilder): Promise<void> {
  const { violations } = await axe.exclude(FURTHER_ROWS).analyze();
  const found = violations.map(({ id, nodes }) => ({
    id,
    where: nodes.map(({ html, failureSummary }) => `${html}\n${failureSummary}`),
  }));
  expect(found).toEqual([]);
}

/** Excess of a page's width over its window's, px. */
export async function sideways(page: Page): Promise<number> {
  return page.evaluate(
    () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
  );
}

/** Charts of the four values of a calibration; beside them may stand those of consistency. */
export function valueCharts(page: Page) {
  return page.getByRole('figure', { name: /^(Steering offset|LiDAR )/ });
}

/** Opens a part of the robot's page that is shown. */
export async function openPart(page: Page, name: 'Overview' | 'Evidence' | 'History' | 'Raw') {
  const parts = page.getByRole('navigation', { name: 'Parts of this page' });
  const link = parts.getByRole('link', { name });
  await link.click();
  await expect(link).toHaveAttribute('aria-current', 'page');
}

export { expect };
