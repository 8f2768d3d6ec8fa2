import { describe, expect, it } from 'vitest';
import type { Proposal } from '../api/types';
import { evidenceOf, stillChosen, whyNotMine } from './proposal';

const proposal = (given: Partial<Proposal>): Proposal =>
  ({
    id: 1,
    version: 1,
    proposed_by: 'fleetcal',
    approvals: [],
    revision: { origin: 'estimator', evidence: null },
    ...given,
  }) as Proposal;

describe('a proposal', () => {
  it('is not approved by whoever proposed it, nor twice by the same person', () => {
    expect(whyNotMine(proposal({}), 'ada')).toBe('');
    expect(whyNotMine(proposal({ proposed_by: 'ada' }), 'ada')).toContain('somebody else');
    const agreed = proposal({ approvals: [{ by: 'ada', at: '2026-01-01T00:00:00Z' }] });
    expect(whyNotMine(agreed, 'ada')).toContain('You have agreed');
    expect(whyNotMine(agreed, 'bob')).toBe('');
  });

  it('says what it rests on', () => {
    const evidence = {
      from: '2026-01-01T00:00:00Z',
      to: '2026-01-01T00:02:00Z',
      distance_m: 120.4,
    };
    const revision = { origin: 'estimator', evidence } as Proposal['revision'];
    expect(evidenceOf(proposal({ revision }))).toBe('120 m in 2 min');
    expect(evidenceOf(proposal({}))).toBe('none');
  });

  it('drops out of what was chosen when it changes', () => {
    const chosen = new Map([
      [1, 1],
      [2, 1],
    ]);
    const waiting = [proposal({ id: 1, version: 2 }), proposal({ id: 2 }), proposal({ id: 3 })];
    expect(stillChosen(waiting, chosen).map(({ id }) => id)).toEqual([2]);
  });
});
