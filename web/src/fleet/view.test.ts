import { describe, expect, it } from 'vitest';
import { condition, queryOf, viewQuery } from './view.svelte';

describe('a view', () => {
  it('has what is typed and what buttons have chosen', () => {
    const filter = { text: 'site:hamburg', state: 'drift', connection: 'silent', sort: '' };
    expect(queryOf(filter)).toBe('site:hamburg standing:drift connection:silent');
    expect(queryOf({ text: '', state: null, connection: null, sort: '-age' })).toBe('');
  });

  it('is asked for without what is empty', () => {
    expect(viewQuery('', '')).toBe('');
    expect(viewQuery('a b', '-deviation')).toBe('q=a+b&sort=-deviation');
    expect(viewQuery('', '', 'csv')).toBe('format=csv');
  });

  it('quotes what a group is called, whatever that is', () => {
    expect(condition('site', 'Hall 3, west')).toBe('site:"Hall 3, west"');
    expect(condition('tag', 'a "b" \\ c')).toBe('tag:"a \\"b\\" \\\\ c"');
  });
});
