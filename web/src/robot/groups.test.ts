import { describe, expect, it } from 'vitest';
import { groupsOf } from './groups';

describe('groups that a person types', () => {
  it('are left out where nothing is typed', () => {
    expect(groupsOf({ site: ' ', vehicle_type: '', tags: ' , ' })).toEqual({});
  });

  it('are trimmed, and tags are separated by commas', () => {
    const typed = { site: ' Hamburg', vehicle_type: 'EKX 516 ', tags: 'leased,night shift, ' };
    expect(groupsOf(typed)).toEqual({
      site: 'Hamburg',
      vehicle_type: 'EKX 516',
      tags: ['leased', 'night shift'],
    });
  });
});
