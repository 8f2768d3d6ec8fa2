import { describe, expect, it } from 'vitest';
import { includes } from './me.svelte';
import { passwordProblem } from './password';

describe('roles', () => {
  it('include those before them', () => {
    expect(includes('admin', 'viewer')).toBe(true);
    expect(includes('operator', 'operator')).toBe(true);
    expect(includes('viewer', 'operator')).toBe(false);
    expect(includes('robot', 'viewer')).toBe(false);
  });
});

describe('a new password', () => {
  it('is long enough, and the same twice', () => {
    expect(passwordProblem('short', 'short')).toContain('now 5');
    expect(passwordProblem('correct horse', 'correct house')).toContain('not the same');
    expect(passwordProblem('🐎'.repeat(12), '🐎'.repeat(12))).toBe('');
  });
});
