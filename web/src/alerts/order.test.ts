import { describe, expect, it } from 'vitest';
import type { Alert, AlertKind, AlertState } from '../api/types';
import { fires } from './alerts.svelte';
import { bySeverity } from './order';

const alert = (id: number, kind: AlertKind, state: AlertState): Alert =>
  ({ id, kind, state, began: '2026-01-01T00:00:00Z' }) as Alert;

describe('alerts', () => {
  it('come with what fires first, then the worst', () => {
    const found = [
      alert(1, 'fault', 'alerting'),
      alert(2, 'rollback_failed', 'pending'),
      alert(3, 'drift', 'recovering'),
      alert(4, 'drift', 'alerting'),
    ].toSorted(bySeverity);
    expect(found.map(({ id }) => id)).toEqual([4, 1, 3, 2]);
  });

  it('fire while what they are about is so, or while nobody can tell', () => {
    const firing = (['pending', 'alerting', 'recovering', 'no_data', 'normal'] as const).filter(
      (state) => fires({ state }),
    );
    expect(firing).toEqual(['alerting', 'no_data']);
  });
});
