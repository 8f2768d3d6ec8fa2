import svelte from 'eslint-plugin-svelte';
import ts from 'typescript-eslint';
import svelteConfig from './svelte.config.js';

export default ts.config(
  { ignores: ['dist', 'src/api/schema.d.ts', 'test-results'] },
  ...ts.configs.recommended,
  ...svelte.configs.recommended,
  {
    files: ['**/*.svelte', '**/*.svelte.ts'],
    languageOptions: { parserOptions: { parser: ts.parser, svelteConfig } },
  },
  {
    rules: {
      'max-lines': ['error', { max: 400, skipBlankLines: true }],
      'svelte/no-navigation-without-resolve': 'off',
      // Maps and dates here are replaced, never altered in place.
      'svelte/prefer-svelte-reactivity': 'off',
      // Robots name themselves: nothing they send may become markup.
      'svelte/no-at-html-tags': 'error',
    },
  },
);
