import { describe, expect, it } from 'vitest';
import type { Robot } from '../api/types';
import { awayText, connectionFace, CONNECTIONS, connectionOf, lastKnown } from './connection';
import { BY_URGENCY, STANDINGS } from './standing';

const NOW_MS = Date.parse('2026-11-22T12:00:00Z');
const heard = (stale: boolean, state: Robot['state'], until?: string, alive = false) => ({
  stale,
  state,
  alive,
  connection: {
    state: 'silent' as const,
    silent_since: null,
    maintenance: until ? { until, by: 'ada', at: until, reason: 'parked' } : null,
  },
});

describe('a robot in maintenance', () => {
  const until = '2026-11-22T18:00:00Z';

  it('is not silent until that ends', () => {
    const parked = heard(true, 'calibrated', until);
    expect(connectionOf(parked, NOW_MS)).toBe('maintenance');
    expect(connectionOf(parked, Date.parse(until))).toBe('silent');
    expect(connectionOf(heard(false, 'calibrated', until), NOW_MS)).toBe('online');
  });

  it('says until when, who says so and why, also while it drives', () => {
    const face = (stale: boolean) => connectionFace(heard(stale, 'calibrated', until), NOW_MS);
    for (const stale of [true, false]) {
      expect(face(stale).meaning).toMatch(/In maintenance until .+ 2026.+, says ada: parked\.$/);
    }
    expect(face(true).word).toBe('In maintenance');
    expect(face(false).word).toBe('Online, in maintenance');
    expect(face(false).meaning).toContain('sends data');
    expect(connectionFace(heard(false, 'calibrated'), NOW_MS)).toBe(CONNECTIONS.online);
    for (const stale of [true, false]) {
      const text = awayText(heard(stale, 'calibrated', until), NOW_MS);
      expect(text).toMatch(/^In maintenance until .*\d\d:\d\d: parked \(ada\)$/);
    }
    expect(awayText(heard(true, 'calibrated'), NOW_MS)).toMatch(/^Check that the robot is on/);
    expect(awayText(heard(false, 'calibrated'), NOW_MS)).toBe('');
  });
});

describe('a silent robot', () => {
  it('is told from one that is online', () => {
    expect(connectionOf(heard(false, 'calibrated'), NOW_MS)).toBe('online');
    expect(connectionOf(heard(true, 'calibrated'), NOW_MS)).toBe('silent');
    expect(connectionOf(heard(false, 'no_data'), NOW_MS)).toBe('silent');
    expect(CONNECTIONS.online.shape).not.toBe(CONNECTIONS.silent.shape);
  });

  it('may be connected all the same', () => {
    const face = (stale: boolean, alive: boolean) =>
      connectionFace(heard(stale, 'calibrated', undefined, alive), NOW_MS);
    expect(face(true, true).meaning).toContain('connected');
    expect(face(true, false)).toBe(CONNECTIONS.silent);
    expect(face(false, true)).toBe(CONNECTIONS.online);
  });

  it('is never green, whatever was known of it last', () => {
    for (const standing of BY_URGENCY) {
      for (const connection of ['silent', 'maintenance'] as const) {
        const { tone } = lastKnown(STANDINGS[standing], connection);
        expect(['good', 'active'], standing).not.toContain(tone);
      }
    }
    expect(lastKnown(STANDINGS.calibrated, 'online').tone).toBe('good');
    expect(lastKnown(STANDINGS.drift, 'silent')).toBe(STANDINGS.drift);
  });
});
