/** Which page an address shows, by the browser's History API. */

export const SETTINGS = ['policy', 'users', 'tokens', 'webhooks'] as const;
export type Setting = (typeof SETTINGS)[number];

export type Route =
  | { page: 'fleet' }
  | { page: 'robot'; id: string }
  | { page: 'approvals' }
  | { page: 'proposal'; id: number }
  | { page: 'alerts' }
  | { page: 'audit' }
  | { page: 'settings'; of: Setting }
  | { page: 'health' }
  | { page: 'setup' }
  | { page: 'account' }
  | { page: 'missing'; path: string };

/** Pages that are an address and nothing else. */
const PLAIN: Record<string, Route> = {
  '/': { page: 'fleet' },
  '/approvals': { page: 'approvals' },
  '/alerts': { page: 'alerts' },
  '/audit': { page: 'audit' },
  '/settings': { page: 'settings', of: 'policy' },
  '/health': { page: 'health' },
  '/setup': { page: 'setup' },
  '/account': { page: 'account' },
};

/** The page at `path`. */
export function route(path: string): Route {
  const plain = Object.hasOwn(PLAIN, path) ? PLAIN[path] : undefined;
  if (plain) return plain;
  const missing: Route = { page: 'missing', path };
  const [, folder, name] = /^\/([a-z]+)\/([^/]+)\/?$/.exec(path) ?? [];
  if (folder === 'approvals' && name && /^\d{1,15}$/.test(name)) {
    return { page: 'proposal', id: Number(name) };
  }
  if (folder === 'settings') {
    const of = SETTINGS.find((setting) => setting === name);
    return of ? { page: 'settings', of } : missing;
  }
  if (folder !== 'robots' || name === undefined) return missing;
  try {
    return { page: 'robot', id: decodeURIComponent(name) };
  } catch {
    return missing;
  }
}

/** The address of a proposal's page. */
export function proposalPath(id: number): string {
  return `/approvals/${id}`;
}

/** The address of a robot's page. */
export function robotPath(id: string): string {
  return `/robots/${encodeURIComponent(id)}`;
}

/** The address with some of its query parameters changed; `null` takes one away. */
export function withQuery(url: URL, changes: Record<string, string | null>): string {
  const query = new URLSearchParams(url.search);
  for (const [key, value] of Object.entries(changes)) {
    if (value === null || value === '') query.delete(key);
    else query.set(key, value);
  }
  const text = query.toString();
  return url.pathname + (text === '' ? '' : `?${text}`);
}

/** A page that is still read replaces its heading within this time. */
const HEADING_WITHIN_MS = 3_000;

/** Puts the focus on the page's heading, and again on the one that takes its place. */
function focusHeading(): void {
  const heading = () => document.querySelector<HTMLElement>('h1');
  requestAnimationFrame(() => heading()?.focus());
  const observer = new MutationObserver(() => {
    if (document.activeElement === document.body) heading()?.focus({ preventScroll: true });
  });
  observer.observe(document.body, { childList: true, subtree: true });
  setTimeout(() => observer.disconnect(), HEADING_WITHIN_MS);
}

/** Where the reader is. Everything that depends on the address derives from it. */
class Place {
  url = $state.raw(new URL(globalThis.location?.href ?? 'http://localhost/'));
  route = $derived(route(this.url.pathname));

  /** Goes to an address of ours. A change of page starts at its top, with its heading in focus. */
  go(href: string, replace = false): void {
    const next = new URL(href, this.url);
    const samePage = next.pathname === this.url.pathname;
    if (replace) history.replaceState(null, '', next);
    else if (next.href !== this.url.href) history.pushState(null, '', next);
    this.url = next;
    if (!samePage) {
      scrollTo(0, 0);
      focusHeading();
    }
  }

  /** Follows links and the back button; returns how to stop. */
  listen(): () => void {
    const onPop = () => {
      this.url = new URL(location.href);
    };
    const onClick = (event: MouseEvent) => {
      if (event.defaultPrevented || event.button !== 0) return;
      if (event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return;
      const link = (event.target as Element | null)?.closest('a');
      if (!link || link.target !== '' || link.hasAttribute('download')) return;
      const href = new URL(link.href, location.href);
      if (href.origin !== location.origin || href.pathname.startsWith('/api/')) return;
      if (href.hash !== '' && href.pathname === location.pathname) return;
      event.preventDefault();
      this.go(href.href);
    };
    addEventListener('popstate', onPop);
    document.addEventListener('click', onClick);
    return () => {
      removeEventListener('popstate', onPop);
      document.removeEventListener('click', onClick);
    };
  }
}

export const place = new Place();
