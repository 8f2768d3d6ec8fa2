import { describe, expect, it } from 'vitest';
import { tabOf } from './tabs';

describe("the parts of a robot's page", () => {
  const tab = (query: string) => tabOf(new URLSearchParams(query));

  it('stand in the address', () => {
    expect(tab('')).toBe('overview');
    expect(tab('show=raw')).toBe('raw');
    expect(tab('show=raw&range=1w')).toBe('raw');
    expect(tab('show=toString')).toBe('overview');
  });

  it('are the history for an address that names a time', () => {
    expect(tab('range=5y')).toBe('history');
    expect(tab('from=2026-01-01T00:00:00Z&to=2026-01-02T00:00:00Z')).toBe('history');
  });
});
