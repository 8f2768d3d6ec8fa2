import { describe, expect, it } from 'vitest';
import { sentence } from './client';

describe('a reason given by the service', () => {
  it('begins a line and takes one full stop', () => {
    expect(sentence(' no robot x is known. ')).toBe('No robot x is known');
    expect(sentence('')).toBe('');
  });
});
