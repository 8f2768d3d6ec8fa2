import { describe, expect, it } from 'vitest';
import { wheelbase } from './vehicle';

describe('a typed wheelbase', () => {
  it('may have a comma and its unit', () => {
    expect(wheelbase(' 1,2 ')).toEqual({ ok: true, metres: 1.2 });
    expect(wheelbase('1.54757 m')).toEqual({ ok: true, metres: 1.54757 });
    expect(wheelbase('.8')).toEqual({ ok: true, metres: 0.8 });
  });

  it.each(['', '0', '-1', '31', '1.2.3', '1e3', 'NaN', 'Infinity', 'two', '1200 mm'])(
    'is refused as %j',
    (typed) => {
      expect(wheelbase(typed).ok).toBe(false);
    },
  );
});
