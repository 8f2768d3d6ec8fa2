import { expect, test } from 'vitest';
import type { Rollout } from '../api/types';
import { firstWaves, planOf } from './draft';
import { lostOf, resumptionOf, takeOf } from './words';

test('typed waves make a plan', () => {
  const plan = planOf(firstWaves());
  expect(plan).toEqual([
    { take: { robots: 2 }, verified_share: 1, failed_share: 0 },
    { take: { share: 0.2 }, verified_share: 0.9, failed_share: 0.05 },
    { take: 'rest', verified_share: 0.9, failed_share: 0.05 },
  ]);
  if (typeof plan === 'string') throw new Error(plan);
  expect(plan.map(({ take }) => takeOf(take))).toEqual(['2 robots', '20 %', 'the rest']);
});

test('the first wrong wave is named', () => {
  const [first, second, last] = firstWaves() as [never, never, never];
  const wrong = (wave: object) =>
    planOf([first, { ...(second as object), ...wave } as never, last]);
  expect(wrong({ value: '0' })).toBe('Wave 2: the share must be more than 0 and at most 100 %');
  expect(wrong({ take: 'robots', value: '1,5' })).toMatch(/number of robots/);
  expect(wrong({ take: 'q', value: ' ' })).toBe('Wave 2: a query is missing');
  expect(wrong({ verified: '' })).toMatch(/^Wave 2: verified must be/);
  expect(wrong({ failed: '100' })).toMatch(/^Wave 2: failed must be/);
  expect(wrong({ verified: '12,5' })).toBeInstanceOf(Array);
});

test('who resumes accepts the lost robots of a halted roll-out only', () => {
  const counts = { waiting: 0, released: 0, underway: 3, verified: 2 };
  const waves = [
    { counts: { ...counts, failed: 2, left_out: 1 } },
    { counts: { ...counts, failed: 1, left_out: 0 } },
  ];
  const halted = { state: 'halted', waves } as unknown as Rollout;
  expect(lostOf(halted)).toEqual([
    { failed: 2, left_out: 1 },
    { failed: 1, left_out: 0 },
  ]);
  expect(resumptionOf(halted)).toContain('You accept 3 failed and 1 left out');
  expect(resumptionOf({ ...halted, state: 'paused' })).toContain('Nothing is accepted');
});
