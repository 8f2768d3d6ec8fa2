import { beforeEach, describe, expect, it } from 'vitest';
import { drafts } from './drafts.svelte';

describe('what was typed', () => {
  beforeEach(() => {
    drafts.belongTo('');
    drafts.belongTo('ada');
  });

  it('is there again for the same person', () => {
    drafts.keep('reason', 'narrow aisles');
    drafts.belongTo('ada');
    expect(drafts.get('reason')).toBe('narrow aisles');
    drafts.forget('reason');
    expect(drafts.get('reason')).toBeUndefined();
  });

  it('is not shown to somebody else', () => {
    drafts.keep('reason', 'narrow aisles');
    drafts.belongTo('bob');
    expect(drafts.get('reason')).toBeUndefined();
  });

  it('is not kept when it is empty', () => {
    drafts.keep('reason', 'x');
    drafts.keep('reason', '');
    expect(drafts.get('reason')).toBeUndefined();
  });
});
