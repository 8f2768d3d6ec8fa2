import { defineConfig } from '@playwright/test';
import base from './playwright.config';

/** Makes the pictures of the documentation from a running demo. */
export default defineConfig({
  ...base,
  projects: [{ name: 'screenshots', testMatch: 'screenshots.ts' }],
  timeout: 300_000,
});
