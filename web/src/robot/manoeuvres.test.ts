import { describe, expect, it } from 'vitest';
import type { Manoeuvres } from '../api/types';
import { introduction, nothingToDrive, telling } from './manoeuvres';

const manoeuvre = (name: string, uncertainty_taken: number, information_bits: number) =>
  ({ name, uncertainty_taken, information_bits }) as Manoeuvres['items'][number];

describe('the recommended manoeuvres', () => {
  it('say that nothing is missing only when no parameter still needs motion', () => {
    expect(introduction([], false)).toMatch(/^All parameters converged\./);
    // A fresh robot: none of the sigmas is too large, and two parameters are learning.
    expect(introduction(['lidar_x', 'lidar_y'], false)).toBe(
      'Not converged yet: LiDAR x, LiDAR y. Ranked by information per metre, after what these need.',
    );
    expect(introduction([], true)).not.toContain('converged');
  });

  it('begin with what the top of the page asks for', () => {
    const items = ['two stops', 'a left turn', 'a figure-eight'].map((instruction) => ({
      ...manoeuvre(instruction, 0, 0.5),
      instruction,
    }));
    const order = (needs: string[]) => telling(items, needs).map(({ name }) => name);
    expect(order(['a figure-eight', 'more driving'])).toEqual([
      'a figure-eight',
      'two stops',
      'a left turn',
    ]);
    expect(order(['a left turn', 'a figure-eight'])).toEqual([
      'a left turn',
      'a figure-eight',
      'two stops',
    ]);
    expect(order([])).toEqual(items.map(({ name }) => name));
  });

  it('leave out what would tell nothing', () => {
    const names = (...items: Manoeuvres['items']) => telling(items, []).map(({ name }) => name);
    const [turn, stop] = [manoeuvre('turn', 0, 0.31), manoeuvre('stop', 0, 0.04)];
    expect(names(turn, stop)).toEqual(['turn']);
    expect(names(stop)).toEqual([]);
    expect(nothingToDrive([])).toMatch(/^All parameters converged/);
    expect(nothingToDrive(['lidar_x'])).toMatch(/^Not converged yet: LiDAR x\./);
    // While sigmas are too large, what does not make them smaller is no help.
    expect(names(manoeuvre('circle', 0.4, 0.1), turn)).toEqual(['circle']);
  });
});
