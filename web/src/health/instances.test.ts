import { describe, expect, it } from 'vitest';
import { clockAhead, concerns, dutiesOf, instanceFace, vacant } from './instances';

const well = { lease_left_s: 4.5, linked: true, draining: false, clock_ahead_s: 0.1 };

describe('an instance', () => {
  it('stands as the worst that is so', () => {
    expect(instanceFace(well).word).toBe('Serving');
    expect(instanceFace({ ...well, draining: true }).word).toBe('Draining');
    expect(instanceFace({ ...well, draining: true, linked: false }).word).toBe('No router');
    expect(instanceFace({ ...well, linked: false, clock_ahead_s: -10.1 }).word).toBe('Clock off');
    expect(instanceFace({ ...well, linked: false, lease_left_s: 0 }).word).toBe('Lease ended');
  });

  it('says what asks for a person', () => {
    expect(concerns({ clock_ahead_s: 1, config_differs: false, unheard: [] })).toEqual([]);
    expect(concerns({ clock_ahead_s: -1.001, config_differs: true, unheard: ['b', 'c'] })).toEqual([
      'clock off',
      'configuration differs',
      'does not hear b, c',
    ]);
    expect(clockAhead({ clock_ahead_s: 0.0123 })).toBe('+0.012');
    expect(clockAhead({ clock_ahead_s: -2 })).toBe('\u22122.000');
  });
});

describe('duties', () => {
  const duties = [
    { duty: 'alerts', instance: 'a' },
    { duty: 'webhooks', instance: 'a' },
    { duty: 'retention', instance: null },
  ];

  it('are those of an instance, or nobody\u2019s', () => {
    expect(dutiesOf({ duties }, 'a')).toBe('alerts, webhooks');
    expect(dutiesOf({ duties }, 'b')).toBe('none');
    expect(vacant({ duties })).toEqual(['retention']);
  });
});
