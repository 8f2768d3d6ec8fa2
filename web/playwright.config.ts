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

/** Tests that measure times. */
const MEASURED = 'large.spec.ts';

export default defineConfig({
  testDir: 'e2e',
  testMatch: '*.spec.ts',
  // Tests wait for robots more than they compute. Each worker has a browser and a service of its own;
  // a file's tests share them, in their order.
  workers: Number(process.env.FLEETCAL_BROWSERS ?? 3),
  fullyParallel: false,
  projects: [
    { name: 'pages', testIgnore: MEASURED },
    // Has the machine to itself.
    { name: 'measured', testMatch: MEASURED, dependencies: ['pages'] },
  ],
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
