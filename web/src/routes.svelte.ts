/** Which page an address shows, by the browser's History API. */

export type Route =
  | { page: 'fleet' }
  | { page: 'robot'; id: string }
  | { page: 'setup' }
  | { page: 'account' }
  | { page: 'missing'; path: string };

/** The page at `path`. */
export function route(path: string): Route {
  if (path === '/') return { page: 'fleet' };
  if (path === '/setup') return { page: 'setup' };
  if (path === '/account') return { page: 'account' };
  const robot = /^\/robots\/([^/]+)\/?$/.exec(path)?.[1];
  if (robot === undefined) return { page: 'missing', path };
  try {
    return { page: 'robot', id: decodeURIComponent(robot) };
  } catch {
    return { page: 'missing', path };
  }
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
      requestAnimationFrame(() => document.querySelector<HTMLElement>('h1')?.focus());
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
