import { defineConfig } from '@playwright/test';

/** Debian's Chromium, with everything off that would talk to somebody. */
export const chromium = {
  executablePath: process.env.CHROMIUM_BIN ?? '/usr/bin/chromium',
  args: [
    '--no-sandbox',
    '--disable-gpu',
    '--disable-quic',
    '--no-first-run',
    '--disable-background-networking',
    '--disable-component-update',
    '--disable-sync',
  ],
};

export default defineConfig({
  testDir: 'e2e',
  testMatch: '*.spec.ts',
  workers: Number(process.env.FLEETCAL_BROWSERS ?? 1),
  // Each worker starts one browser and one demo: it takes a while until its robots are calibrated.
  fullyParallel: false,
  // Robots drive and decide while a test looks: what fails is run once more, on a service of its
  // own, and the list names it as flaky.
  retries: 1,
  timeout: 60_000,
  expect: { timeout: 20_000 },
  reporter: [['list']],
  use: {
    launchOptions: chromium,
    viewport: { width: 1440, height: 900 },
    trace: 'off',
  },
});
