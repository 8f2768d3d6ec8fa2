import { describe, expect, it } from 'vitest';
import { edited, effect, typedOf } from './edit';

const CONFIG = {
  model: 'tricycle',
  wheelbase_m: 1.55,
  nominal_extrinsics: { x_m: 0.4301, y_m: 0, yaw_rad: 0.1 },
} as Parameters<typeof typedOf>[0];

describe('an edit of a vehicle', () => {
  it('keeps what is not typed again bit for bit', () => {
    const typed = typedOf(CONFIG);
    expect(typed).toMatchObject({ wheelbase: '1.55', x_mm: '430.1', y_mm: '0' });
    const same = edited(CONFIG, typed);
    expect(same).toEqual({ ok: true, config: CONFIG });
    const other = edited(CONFIG, { ...typed, wheelbase: '1,6', y_mm: '−5' });
    expect(other.ok && other.config).toEqual({
      ...CONFIG,
      wheelbase_m: 1.6,
      nominal_extrinsics: { ...CONFIG.nominal_extrinsics, y_m: -0.005 },
    });
  });

  it('removes a mount that is emptied, and refuses half of one', () => {
    const typed = { ...typedOf(CONFIG), x_mm: '', y_mm: '' };
    expect(edited(CONFIG, typed).ok).toBe(false);
    const none = edited(CONFIG, { ...typed, yaw_deg: ' ' });
    expect(none.ok && none.config.nominal_extrinsics).toBe(null);
  });

  it('says what restarts', () => {
    expect(effect([])).toContain('goes on');
    expect(effect(['wheelbase_m', 'nominal_extrinsics'])).toContain(
      'since the wheelbase and the nominal mount change',
    );
  });
});
