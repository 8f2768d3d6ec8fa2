/** Requests to the service. Every failure becomes one {@link Refusal} with a sentence in it. */

import type { Problem } from './types';
import { now } from '../ui/time.svelte';

const REQUEST_TIMEOUT_MS = 10_000;
const BASE = '/api/v1';
const LIST_PAGE = 1000;

/** Error of a request that failed. */
export class Refusal extends Error {
  constructor(
    /** Description of the failure, in a sentence for people. */
    message: string,
    /** HTTP status, or 0 without an answer. */
    readonly status: number,
  ) {
    super(message);
  }

  /** True if the document has changed since it was read. */
  get changed(): boolean {
    return this.status === 412;
  }
}

/** An answer with the version that a later change must name. */
export interface Answer<T> {
  body: T;
  etag: string | null;
}

/**
 * Receives the `code` of every answer that requires the user to sign in, for the first time or
 * again.
 */
let unauthorised: (code: string) => void = () => undefined;

/** Registers `listener` for answers of the service that require a credential. */
export function onUnauthorised(listener: (code: string) => void): void {
  unauthorised = listener;
}

/** Returns the reason of a failure, in a sentence. */
export function problemOf(error: unknown): string {
  return error instanceof Refusal ? error.message : String(error);
}

/** Returns a text that can begin a line and precede a full stop. */
export function sentence(text: string): string {
  const trimmed = text.trim().replace(/\.$/, '');
  return trimmed.charAt(0).toUpperCase() + trimmed.slice(1);
}

async function refusal(response: Response): Promise<Refusal> {
  let problem: Partial<Problem> = {};
  try {
    problem = (await response.json()) as Partial<Problem>;
  } catch {
    // Not a problem document: the status has to do.
  }
  if (response.status === 401) unauthorised(problem.code ?? '');
  const text = problem.detail ?? problem.title ?? `The service answered ${response.status}`;
  return new Refusal(sentence(text), response.status);
}

/** Sends any request; most are {@link get}, {@link put}, {@link post} or {@link remove}. */
export async function send(path: string, init: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(BASE + path, {
      ...init,
      headers: { accept: 'application/json', ...init.headers },
      signal: init.signal ?? AbortSignal.timeout(REQUEST_TIMEOUT_MS),
    });
  } catch (error) {
    if (error instanceof DOMException && error.name === 'AbortError') throw error;
    throw new Refusal('The service cannot be reached', 0);
  }
  const date = Date.parse(response.headers.get('date') ?? '');
  if (Number.isFinite(date)) now.learn(date);
  if (!response.ok) throw await refusal(response);
  return response;
}

/** Sends a GET for a JSON document. */
export async function get<T>(path: string, signal?: AbortSignal): Promise<Answer<T>> {
  const response = await send(path, signal ? { signal } : {});
  return { body: (await response.json()) as T, etag: response.headers.get('etag') };
}

/**
 * Sends a PUT of a JSON document; `etag` is the version that it replaces, null to create the
 * document.
 */
export async function put<T>(path: string, body: unknown, etag: string | null): Promise<T> {
  const condition: HeadersInit = etag === null ? { 'if-none-match': '*' } : { 'if-match': etag };
  const response = await send(path, {
    method: 'PUT',
    body: JSON.stringify(body),
    headers: { 'content-type': 'application/json', ...condition },
  });
  return (await response.json()) as T;
}

/** Sends a change of the document at version `etag`; refused if its version differs. */
export async function change<T>(
  method: 'POST' | 'PUT' | 'PATCH',
  path: string,
  body: unknown,
  etag?: string,
): Promise<Answer<T>> {
  const looked = etag === undefined ? {} : { 'if-match': etag };
  const response = await send(path, {
    method,
    body: JSON.stringify(body),
    headers: { 'content-type': 'application/json', ...looked },
  });
  return { body: (await response.json()) as T, etag: response.headers.get('etag') };
}

/** Returns the `ETag` of version `version`, for lists that contain versions. */
export function etagOf(version: number): string {
  return `"${version}"`;
}

/** Reads the entries of a paginated list, up to `most` of them. */
export async function list<T>(
  path: string,
  query: Record<string, string>,
  most: number,
): Promise<T[]> {
  const found: T[] = [];
  let cursor: string | null | undefined;
  do {
    const limit = String(Math.min(LIST_PAGE, most - found.length));
    const parameters = new URLSearchParams({ ...query, limit });
    if (cursor) parameters.set('cursor', cursor);
    const { body } = await get<{ items: T[]; next?: string | null }>(`${path}?${parameters}`);
    found.push(...body.items);
    cursor = body.next;
  } while (cursor && found.length < most);
  return found;
}

/** Returns an idempotency key: a request that creates something is executed once per key. */
export function onceKey(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, '0')).join('');
}

/** Sends a DELETE; `etag` is the displayed version, if the resource has versions. */
export async function remove(path: string, etag?: string): Promise<void> {
  await send(path, { method: 'DELETE', headers: etag ? { 'if-match': etag } : {} });
}

/** Sends a POST that creates something; repeating it under the same key, if any, has no effect. */
export async function post<T>(path: string, body: unknown, idempotencyKey?: string): Promise<T> {
  const key: HeadersInit = idempotencyKey ? { 'idempotency-key': idempotencyKey } : {};
  const response = await send(path, {
    method: 'POST',
    body: JSON.stringify(body),
    headers: { 'content-type': 'application/json', ...key },
  });
  return (await response.json()) as T;
}
