import { describe, expect, it } from 'vitest';
import { differences, queryOf } from './query';

describe('the audit', () => {
  it('is asked for with what stands in the address', () => {
    const page = new URLSearchParams(
      'robot=tugger_01&actor=%20&from=2026-01-02T03:04Z&to=nonsense',
    );
    expect(queryOf(page)).toBe('robot=tugger_01&from=2026-01-02T03%3A04%3A00.000Z');
    expect(queryOf(new URLSearchParams('page=3'))).toBe('');
  });

  it('says what differs between two records, and nothing else', () => {
    const before = { state: 'proposed', id: 3, approvals: [] };
    const after = { state: 'approved', id: 3, approvals: [{ by: '<b>ada</b>' }] };
    expect(differences(before, after)).toEqual([
      { field: 'state', from: 'proposed', to: 'approved' },
      { field: 'approvals', from: '[]', to: '[{"by":"<b>ada</b>"}]' },
    ]);
    expect(differences(null, { id: 1 })).toEqual([{ field: 'id', from: '', to: '1' }]);
  });
});
