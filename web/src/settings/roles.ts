/** Roles that a person can have, and a token. */

import type { Role } from '../api/types';

export const ROLES: readonly Role[] = ['viewer', 'operator', 'approver', 'admin'];
export const TOKEN_ROLES: readonly Role[] = [...ROLES, 'robot'];
