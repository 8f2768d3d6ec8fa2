import { expect, test } from 'vitest';
import { extent } from './moments';

test('a moment says its duration and size', () => {
  const moment = {
    id: 7,
    robot: 'tugger_01',
    kept_at: '2026-01-01T00:01:00Z',
    kind: 'change' as const,
    note: '',
    from: '2026-01-01T00:00:00.2Z',
    to: '2026-01-01T00:00:58Z',
    messages: 6_000,
    bytes: 2_140_000,
  };
  expect(extent(moment)).toBe('58 s, 2.1 MB');
});
