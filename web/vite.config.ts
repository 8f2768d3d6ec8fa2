import { svelte } from '@sveltejs/vite-plugin-svelte';
import { defineConfig } from 'vitest/config';

// The service answers the API while the pages are developed: FLEETCAL_URL=http://127.0.0.1:8080 npm run dev
const service = process.env.FLEETCAL_URL ?? 'http://127.0.0.1:8080';

export default defineConfig({
  plugins: [svelte()],
  build: {
    target: 'es2022',
    // A data: address would need a wider content security policy.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 400,
    // Packages carry it (packaging/release.sh), and the service serves it.
    license: { fileName: 'licenses.md' },
  },
  server: {
    // The glossary is that of the documentation.
    fs: { allow: ['..'] },
    proxy: { '/api': service, '/healthz': service, '/readyz': service, '/metrics': service },
  },
  test: {
    include: ['src/**/*.test.ts'],
    environment: 'node',
  },
});
