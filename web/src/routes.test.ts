import { describe, expect, it } from 'vitest';
import { guidePath, robotPath, route, withQuery } from './routes.svelte';

describe('routes', () => {
  it('find the page of an address', () => {
    expect(route('/')).toEqual({ page: 'fleet' });
    expect(route('/robots/tugger_01')).toEqual({ page: 'robot', id: 'tugger_01' });
    expect(route('/robots/tugger_01/guide')).toEqual({ page: 'guide', id: 'tugger_01' });
    expect(route('/approvals/12/guide')).toMatchObject({ page: 'missing' });
    expect(route('/setup')).toEqual({ page: 'setup' });
    expect(route('/account')).toEqual({ page: 'account' });
    expect(route('/certificates')).toEqual({ page: 'certificates' });
    expect(route('/help')).toEqual({ page: 'help' });
    expect(route('/approvals')).toEqual({ page: 'approvals' });
    expect(route('/approvals/12')).toEqual({ page: 'proposal', id: 12 });
    expect(route('/approvals/twelve')).toMatchObject({ page: 'missing' });
    expect(route('/rollouts')).toEqual({ page: 'rollouts' });
    expect(route('/rollouts/new')).toEqual({ page: 'new_rollout' });
    expect(route('/rollouts/3')).toEqual({ page: 'rollout', id: 3 });
    expect(route('/rollouts/three')).toMatchObject({ page: 'missing' });
    expect(route('/settings')).toEqual({ page: 'settings', of: 'policy' });
    expect(route('/settings/tokens')).toEqual({ page: 'settings', of: 'tokens' });
    expect(route('/settings/everything')).toMatchObject({ page: 'missing' });
    expect(route('/toString')).toMatchObject({ page: 'missing' });
    expect(route('/robots/a/b')).toMatchObject({ page: 'missing' });
    expect(route('/robots/%E0%A4%A')).toMatchObject({ page: 'missing' });
  });

  it('take any name there and back', () => {
    for (const id of ['tugger_01', '<script>', 'a/b?c#d', '%41', 'Gabelstapler ä']) {
      expect(route(robotPath(id))).toEqual({ page: 'robot', id });
      expect(route(guidePath(id))).toEqual({ page: 'guide', id });
    }
  });

  it('change one query parameter and keep the others', () => {
    const url = new URL('http://localhost/?state=learning&q=a');
    expect(withQuery(url, { state: null })).toBe('/?q=a');
    expect(withQuery(url, { q: '', state: 'changed' })).toBe('/?state=changed');
  });
});
