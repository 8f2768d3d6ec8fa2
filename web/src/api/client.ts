/** Requests to the service. Every failure becomes one {@link Refusal} with a sentence in it. */

import type { Problem } from './types';
import { now } from '../ui/time.svelte';

const REQUEST_TIMEOUT_MS = 10_000;
const BASE = '/api/v1';

/** A request that did not do what it was for. */
export class Refusal extends Error {
  constructor(
    /** What went wrong, in a sentence for people. */
    message: string,
    /** The HTTP status, or 0 when no answer came. */
    readonly status: number,
  ) {
    super(message);
  }
}

/** An answer with the version that a later change must name. */
export interface Answer<T> {
  body: T;
  etag: string | null;
}

/** A text that can begin a line, and be followed by a full stop. */
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
  const text = problem.detail ?? problem.title ?? `The service answered ${response.status}`;
  return new Refusal(sentence(text), response.status);
}

async function send(path: string, init: RequestInit): Promise<Response> {
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

/** GET of a JSON document. */
export async function get<T>(path: string, signal?: AbortSignal): Promise<Answer<T>> {
  const response = await send(path, signal ? { signal } : {});
  return { body: (await response.json()) as T, etag: response.headers.get('etag') };
}

/** PUT of a JSON document; `etag` is the version it replaces, null when there is none yet. */
export async function put<T>(path: string, body: unknown, etag: string | null): Promise<T> {
  const condition: HeadersInit = etag === null ? { 'if-none-match': '*' } : { 'if-match': etag };
  const response = await send(path, {
    method: 'PUT',
    body: JSON.stringify(body),
    headers: { 'content-type': 'application/json', ...condition },
  });
  return (await response.json()) as T;
}

/** POST that creates something; sending it again under the same key does nothing. */
export async function post<T>(path: string, body: unknown, idempotencyKey: string): Promise<T> {
  const response = await send(path, {
    method: 'POST',
    body: JSON.stringify(body),
    headers: { 'content-type': 'application/json', 'idempotency-key': idempotencyKey },
  });
  return (await response.json()) as T;
}
