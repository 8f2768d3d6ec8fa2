import { describe, expect, it } from 'vitest';
import type { FleetAction, FleetActionAnswer } from '../api/types';
import { answersTo, AT_ONCE_MAX, outcomeOf, requestsOf } from './bulk';

const ACTION: FleetAction['action'] = { retire: { reason: 'sold' } };
const robots = (count: number) => Array.from({ length: count }, (_, at) => ({ id: `agv_${at}` }));

/** Answer to a request of which everything is done. */
function done({ robots }: FleetAction): FleetActionAnswer {
  const items = robots.map(({ id }) => ({ robot: id, done: true }));
  return { done: items.length, refused: 0, items };
}

describe('action on more robots than one request has', () => {
  it('keeps the outcomes of the others when a request fails', async () => {
    const requests = requestsOf(ACTION, robots(2 * AT_ONCE_MAX + 1));
    const answered = await answersTo(requests, (request) =>
      request === requests[1]
        ? Promise.reject(new Error('no connection'))
        : Promise.resolve(done(request)),
    );
    const outcome = outcomeOf('retire', answered);
    expect(outcome.done).toHaveLength(AT_ONCE_MAX + 1);
    expect(outcome.refused).toHaveLength(AT_ONCE_MAX);
    expect(outcome.refused[0]).toEqual({
      id: `agv_${AT_ONCE_MAX}`,
      why: 'Error: no connection',
    });
  });

  it('is refused as a whole when no request is answered', async () => {
    const refused = answersTo(requestsOf(ACTION, robots(AT_ONCE_MAX + 1)), () =>
      Promise.reject(new Error('no connection')),
    );
    await expect(refused).rejects.toThrow('no connection');
  });
});
