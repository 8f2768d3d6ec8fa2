import { expect, it } from 'vitest';
import { correlations } from './correlation';

it('a correlation is a covariance over both standard deviations', () => {
  const got = correlations([
    [4, -3],
    [-3, 9],
  ]);
  expect(got).toEqual([
    [1, -0.5],
    [-0.5, 1],
  ]);
});

it('a value that is exactly known correlates with none', () => {
  const got = correlations([
    [0, 0],
    [0, 9],
  ]);
  expect(got).toEqual([
    [null, null],
    [null, 1],
  ]);
});
