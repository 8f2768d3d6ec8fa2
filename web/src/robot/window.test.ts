import { describe, expect, it } from 'vitest';
import { extent, type Range, windowOf } from './window';

const hour: Range = { key: '1h', label: '1 h', length_s: 3600 };

describe('the window in an address', () => {
  it('is a range, or the last hour when it cannot be read', () => {
    expect(windowOf(new URLSearchParams('range=1w'))).toMatchObject({ range: { key: '1w' } });
    expect(windowOf(new URLSearchParams('range=soon'))).toMatchObject({ range: { key: '1h' } });
    expect(windowOf(new URLSearchParams('from=x&to=y'))).toMatchObject({ kind: 'range' });
  });

  it('is a cut when both ends are there and in order', () => {
    const from = '2026-11-21T13:00:00Z';
    const to = '2026-11-21T14:00:00Z';
    const cut = windowOf(new URLSearchParams({ from, to }));
    expect(cut).toEqual({
      kind: 'cut',
      from_s: Date.parse(from) / 1000,
      to_s: Date.parse(to) / 1000,
    });
    expect(windowOf(new URLSearchParams({ from: to, to: from }))).toMatchObject({ kind: 'range' });
  });
});

describe('the time shown', () => {
  const window = { kind: 'range', range: hour } as const;

  it('is the whole range once the data fill it', () => {
    expect(extent(window, 10_000, 1_000)).toEqual([6_400, 10_000]);
    expect(extent(window, 10_000, undefined)).toEqual([6_400, 10_000]);
  });

  it('begins with the first data before that, and is never below a minute', () => {
    expect(extent(window, 10_000, 9_800)).toEqual([9_798, 10_000]);
    expect(extent(window, 10_000, 9_999)).toEqual([9_940, 10_000]);
  });
});
