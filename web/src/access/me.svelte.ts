/** Who is signed in, and what that person may do. */

import { get, onUnauthorised, post, remove, Refusal } from '../api/client';
import type { Role, Session } from '../api/types';
import { drafts } from '../ui/drafts.svelte';

/** Roles of people; each may what those before it may. */
const ROLES: readonly Role[] = ['viewer', 'operator', 'approver', 'admin'];

/**
 * `unknown` until the service has said; `out` when nobody is signed in, `setup` when nobody can be
 * because there are no users yet.
 */
export type SignedIn = 'unknown' | 'in' | 'out' | 'setup';

/** Whether `role` may what `wanted` may. */
export function includes(role: Role, wanted: Role): boolean {
  return ROLES.includes(role) && ROLES.indexOf(role) >= ROLES.indexOf(wanted);
}

class Me {
  state = $state<SignedIn>('unknown');
  name = $state('');
  role = $state<Role>('viewer');
  /** Whether a session has ended under the reader's hands. */
  ended = $state(false);
  /** Why the service did not say who is signed in, in a sentence. */
  problem = $state('');

  constructor() {
    onUnauthorised((code) => this.#out(code));
  }

  /** Asks the service. */
  async load(): Promise<void> {
    try {
      this.#in((await get<Session>('/session')).body);
    } catch (error) {
      this.problem = error instanceof Refusal ? error.message : String(error);
    }
  }

  /** Signs in. */
  async signIn(name: string, password: string): Promise<void> {
    this.#in(await post<Session>('/session', { name, password }));
  }

  /** Makes the first administrator, who is then signed in. */
  async setUp(code: string, name: string, password: string): Promise<void> {
    this.#in(await post<Session>('/setup', { code, name, password }));
  }

  /** Signs out; gives why that failed, in a sentence, or nothing. */
  async signOut(): Promise<string> {
    try {
      await remove('/session');
    } catch (error) {
      // Without a session there is nothing left to end.
      if (!(error instanceof Refusal) || error.status !== 401) {
        return error instanceof Refusal ? error.message : String(error);
      }
    }
    this.state = 'out';
    this.ended = false;
    drafts.belongTo('');
    return '';
  }

  /** Whether the reader may what `role` may. */
  may(role: Role): boolean {
    return this.state === 'in' && includes(this.role, role);
  }

  #in({ name, role }: Session): void {
    drafts.belongTo(name);
    this.name = name;
    this.role = role;
    this.state = 'in';
    this.ended = false;
    this.problem = '';
  }

  #out(code: string): void {
    // A refused sign-in says nothing new.
    if (code === 'sign_in_refused') return;
    this.ended = this.state === 'in' || this.ended;
    this.state = code === 'setup_required' ? 'setup' : 'out';
  }
}

export const me = new Me();
