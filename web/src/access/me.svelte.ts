/** The signed-in user and that user's rights. */

import { get, onUnauthorised, post, remove, Refusal } from '../api/client';
import type { Role, Session } from '../api/types';
import { drafts } from '../ui/drafts.svelte';

/** Roles of people in ascending order; each includes the rights of those before it. */
const ROLES: readonly Role[] = ['viewer', 'operator', 'approver', 'admin'];

/**
 * State of signing in: `unknown` before the service's first answer, `in`, `out` when nobody is
 * signed in, `setup` when there are no users yet.
 */
export type SignedIn = 'unknown' | 'in' | 'out' | 'setup';

/** True if `role` includes the rights of `wanted`. */
export function includes(role: Role, wanted: Role): boolean {
  return ROLES.includes(role) && ROLES.indexOf(role) >= ROLES.indexOf(wanted);
}

class Me {
  state = $state<SignedIn>('unknown');
  name = $state('');
  role = $state<Role>('viewer');
  /** True if a session has ended while the page was in use. */
  ended = $state(false);
  /** Reason why the signed-in user could not be queried, in a sentence. */
  problem = $state('');

  constructor() {
    onUnauthorised((code) => this.#out(code));
  }

  /** Queries the signed-in user. */
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

  /** Creates the first administrator, who is then signed in. */
  async setUp(code: string, name: string, password: string): Promise<void> {
    this.#in(await post<Session>('/setup', { code, name, password }));
  }

  /** Signs out; returns the reason of a failure in a sentence, otherwise an empty text. */
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

  /** True if the reader has the rights of `role`. */
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
