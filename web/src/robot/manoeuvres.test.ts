import { describe, expect, it } from 'vitest';
import { introduction } from './manoeuvres';

describe('the recommended manoeuvres', () => {
  it('say that nothing is missing only when no parameter still needs motion', () => {
    expect(introduction([], false)).toMatch(/^All parameters converged\./);
    // A fresh robot: none of the sigmas is too large, and two parameters are learning.
    expect(introduction(['lidar_x', 'lidar_y'], false)).toBe(
      'Not converged yet: LiDAR x, LiDAR y. Ranked by information per metre.',
    );
    expect(introduction([], true)).not.toContain('converged');
  });
});
