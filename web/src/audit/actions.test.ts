import { describe, expect, it } from 'vitest';
import { EVENTS } from '../settings/events';
import { ACTIONS } from './actions';

/** The service's source without its tests, by path. */
const SOURCE = import.meta.glob<string>(
  [
    '../../../service/**/src/**/*.rs',
    '!../../../service/**/tests.rs',
    '!../../../service/**/tests/**',
  ],
  { query: '?raw', import: 'default', eager: true },
);
/** `"proposal.approve"`: a record and what became of it. */
const ACTION =
  /"((?:alert|deployment|event|freeze|maintenance|policy|proposal|robot|rollout|session|shadow|token|user|webhook)\.[a-z_]+)"/g;

describe('the actions that the audit can be filtered by', () => {
  it('are those that the service writes', () => {
    const events = Object.keys(EVENTS);
    const named = Object.values(SOURCE).flatMap((text) => {
      const [code = ''] = text.split('#[cfg(test)]');
      return [...code.matchAll(ACTION)].map(([, name]) => name ?? '');
    });
    const written = [...new Set(named)].filter((name) => !events.includes(name));
    expect([...ACTIONS]).toEqual(written.toSorted());
  });
});
