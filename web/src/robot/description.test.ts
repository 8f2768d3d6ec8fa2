import { describe, expect, it } from 'vitest';
import type { DescribedRobot } from '../api/types';
import { changes, labelOf, prefill, textOf } from './description';

const wheelbase = {
  key: 'wheelbase_m',
  value: 1.2,
  source: 'URDF: rear to steer_joint',
  used: false,
  in_use: null as unknown,
  contradicted: false,
};
const track = { ...wheelbase, key: 'track_m', value: 0.9 };

function described(parts: Partial<DescribedRobot['description']>, proposed: unknown = {}) {
  return {
    description: {
      origins: ['robot_description'],
      values: [wheelbase, track],
      missing: [],
      remarks: [],
      ...parts,
    },
    proposed,
  } as DescribedRobot;
}

describe('what a robot says of itself', () => {
  it('is shown in words', () => {
    expect(labelOf(wheelbase)).toBe('Wheelbase');
    expect(textOf('wheelbase_m', 1.2)).toBe('1.200 m');
    expect(textOf('model', 'bicycle')).toBe('bicycle');
    expect(textOf('nominal_extrinsics', null)).toBe('not set');
    const mount = { x_m: 0.434, y_m: 0, yaw_rad: Math.PI / 2 };
    expect(textOf('nominal_extrinsics', mount)).toBe('x 0.434 m, y 0.000 m, yaw 90.00°');
    const joints = { steering: 'steer', wheels: ['left', 'right'], wheel_radius_m: 0.15 };
    expect(textOf('streams.joints', joints)).toBe('steer; left, right; radius 0.150 m');
  });

  it('changes the configuration where that lacks or contradicts it', () => {
    expect(changes(described({}))).toBe(true);
    expect(changes(described({}, null))).toBe(false);
    const inUse = (in_use: number, contradicted: boolean) => [
      { ...wheelbase, in_use, contradicted },
      track,
    ];
    expect(changes(described({ values: inUse(1.2, false) }))).toBe(false);
    expect(changes(described({ values: inUse(1.55, true) }))).toBe(true);
  });

  it('fills the form and names its sources', () => {
    const model = { ...wheelbase, key: 'model', value: 'tricycle', source: 'URDF: driven' };
    const filled = prefill(described({ values: [model, wheelbase, track] }, { model: 'tricycle' }));
    expect(filled.model).toBe('tricycle');
    expect(filled.wheelbase).toBe('1.2');
    expect(filled.sources).toEqual([
      'robot_description',
      'Steering: tricycle, by URDF: driven',
      'Wheelbase: 1.200 m, by URDF: rear to steer_joint',
    ]);
    expect(prefill(described({ values: [] }, null)).sources).toEqual([]);
  });
});
