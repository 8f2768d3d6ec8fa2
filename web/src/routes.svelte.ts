/** Maps addresses to pages, by the browser's History API. */

export const SETTINGS = ['policy', 'users', 'tokens', 'webhooks'] as const;
export type Setting = (typeof SETTINGS)[number];

export type Route =
  | { page: 'fleet' }
  | { page: 'robot'; id: string }
  | { page: 'guide'; id: string }
  | { page: 'approvals' }
  | { page: 'proposal'; id: number }
  | { page: 'rollouts' }
  | { page: 'new_rollout' }
  | { page: 'rollout'; id: number }
  | { page: 'alerts' }
  | { page: 'audit' }
  | { page: 'certificates' }
  | { page: 'settings'; of: Setting }
  | { page: 'health' }
  | { page: 'setup' }
  | { page: 'account' }
  | { page: 'help' }
  | { page: 'missing'; path: string };

/** Pages whose address has no parameters. */
const PLAIN: Record<string, Route> = {
  '/': { page: 'fleet' },
  '/approvals': { page: 'approvals' },
  '/rollouts': { page: 'rollouts' },
  '/rollouts/new': { page: 'new_rollout' },
  '/alerts': { page: 'alerts' },
  '/audit': { page: 'audit' },
  '/certificates': { page: 'certificates' },
  '/settings': { page: 'settings', of: 'policy' },
  '/health': { page: 'health' },
  '/setup': { page: 'setup' },
  '/account': { page: 'account' },
  '/help': { page: 'help' },
};

/** Addresses of the service outside the dashboard, which the browser follows itself. */
const ELSEWHERE = /^\/(api|docs|licenses\.md)(\/|$)/;

/** Returns the page at `path`. */
export function route(path: string): Route {
  const plain = Object.hasOwn(PLAIN, path) ? PLAIN[path] : undefined;
  if (plain) return plain;
  const missing: Route = { page: 'missing', path };
  const [, folder, name, part] = /^\/([a-z]+)\/([^/]+)(?:\/(guide))?\/?$/.exec(path) ?? [];
  if (part !== undefined && folder !== 'robots') return missing;
  if (folder === 'approvals' && name && /^\d{1,15}$/.test(name)) {
    return { page: 'proposal', id: Number(name) };
  }
  if (folder === 'rollouts' && name && /^\d{1,15}$/.test(name)) {
    return { page: 'rollout', id: Number(name) };
  }
  if (folder === 'settings') {
    const of = SETTINGS.find((setting) => setting === name);
    return of ? { page: 'settings', of } : missing;
  }
  if (folder !== 'robots' || name === undefined) return missing;
  try {
    return { page: part === undefined ? 'robot' : 'guide', id: decodeURIComponent(name) };
  } catch {
    return missing;
  }
}

/** Returns the address of a proposal's page. */
export function proposalPath(id: number): string {
  return `/approvals/${id}`;
}

/** Returns the address of a roll-out's page. */
export function rolloutPath(id: number): string {
  return `/rollouts/${id}`;
}

/** Returns the address of a view of the fleet. */
export function fleetPath(q: string): string {
  return q === '' ? '/' : `/?${new URLSearchParams({ q })}`;
}

/** Returns the address of a robot's page. */
export function robotPath(id: string): string {
  return `/robots/${encodeURIComponent(id)}`;
}

/** Returns the address of a robot's guided calibration. */
export function guidePath(id: string): string {
  return `${robotPath(id)}/guide`;
}

/** Returns the address with some query parameters changed; `null` removes one. */
export function withQuery(url: URL, changes: Record<string, string | null>): string {
  const query = new URLSearchParams(url.search);
  for (const [key, value] of Object.entries(changes)) {
    if (value === null || value === '') query.delete(key);
    else query.set(key, value);
  }
  const text = query.toString();
  return url.pathname + (text === '' ? '' : `?${text}`);
}

/** Time within which a page that is still loading replaces its heading. */
const HEADING_WITHIN_MS = 3_000;

/** Focuses the page's heading, and again the one that replaces it. */
function focusHeading(): void {
  const heading = () => document.querySelector<HTMLElement>('h1');
  requestAnimationFrame(() => heading()?.focus());
  const observer = new MutationObserver(() => {
    if (document.activeElement === document.body) heading()?.focus({ preventScroll: true });
  });
  observer.observe(document.body, { childList: true, subtree: true });
  setTimeout(() => observer.disconnect(), HEADING_WITHIN_MS);
}

/**
 * Time within which a page that is still loading reaches the height at which the reader left it.
 */
const HEIGHT_WITHIN_MS = 3_000;
/** Rest after which the scroll position is stored. */
const SCROLL_RESTS_MS = 120;
/** Input events that end the restoring of the scroll position. */
const MOVES = ['wheel', 'touchmove', 'keydown', 'pointerdown'] as const;

/** Scroll position of the current entry of the browser's history. */
interface Entry {
  scroll_px?: number;
}

/** Restores the scroll position once the page is high enough; returns a function that stops it. */
function scrollBack(to_px: number): () => void {
  const until_ms = performance.now() + HEIGHT_WITHIN_MS;
  let going = true;
  const stop = () => {
    going = false;
    for (const move of MOVES) removeEventListener(move, stop, true);
  };
  for (const move of MOVES) addEventListener(move, stop, true);
  const step = () => {
    if (!going) return;
    const room_px = document.documentElement.scrollHeight - innerHeight;
    const late = performance.now() > until_ms;
    if (room_px >= to_px || late) {
      scrollTo(0, to_px);
      stop();
    } else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
  return stop;
}

/** Goes to the element that a fragment names, as soon as it is there, and focuses it. */
function goToFragment(hash: string): void {
  const until_ms = performance.now() + HEIGHT_WITHIN_MS;
  const step = () => {
    const element = document.getElementById(decodeURIComponent(hash.slice(1)));
    if (element) {
      element.scrollIntoView();
      element.focus({ preventScroll: true });
    } else if (performance.now() < until_ms) requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

/** Current address. Everything that depends on the address derives from it. */
class Place {
  url = $state.raw(new URL(globalThis.location?.href ?? 'http://localhost/'));
  route = $derived(route(this.url.pathname));
  /** True if the reader came by the browser's history and expects the earlier state of the page. */
  returned = false;
  #resting: ReturnType<typeof setTimeout> | undefined;
  #scrolling: () => void = () => undefined;

  /**
   * Goes to an address of the dashboard. A new page starts at its top, with its heading in focus.
   */
  go(href: string, replace = false): void {
    const next = new URL(href, this.url);
    const samePage = next.pathname === this.url.pathname;
    this.#scrolling();
    this.#keepScroll();
    this.returned = false;
    if (replace) history.replaceState(history.state, '', next);
    else if (next.href !== this.url.href) history.pushState(null, '', next);
    this.url = next;
    if (samePage) return;
    scrollTo(0, 0);
    if (next.hash === '') focusHeading();
    else goToFragment(next.hash);
  }

  /** Follows links and the back button; returns a function that stops it. */
  listen(): () => void {
    const onPop = () => {
      clearTimeout(this.#resting);
      this.returned = true;
      this.url = new URL(location.href);
      this.#scrollBack();
    };
    const onScroll = () => {
      clearTimeout(this.#resting);
      this.#resting = setTimeout(() => this.#keepScroll(), SCROLL_RESTS_MS);
    };
    const onClick = (event: MouseEvent) => {
      if (event.defaultPrevented || event.button !== 0) return;
      if (event.metaKey || event.ctrlKey || event.shiftKey || event.altKey) return;
      const link = (event.target as Element | null)?.closest('a');
      if (!link || link.target !== '' || link.hasAttribute('download')) return;
      const href = new URL(link.href, location.href);
      if (href.origin !== location.origin || ELSEWHERE.test(href.pathname)) return;
      if (href.hash !== '' && href.pathname === location.pathname) return;
      event.preventDefault();
      this.go(href.href);
    };
    // The browser would scroll before the page has what it scrolls to.
    history.scrollRestoration = 'manual';
    this.#scrollBack();
    addEventListener('popstate', onPop);
    addEventListener('scroll', onScroll, { passive: true });
    document.addEventListener('click', onClick);
    return () => {
      clearTimeout(this.#resting);
      this.#scrolling();
      removeEventListener('popstate', onPop);
      removeEventListener('scroll', onScroll);
      document.removeEventListener('click', onClick);
    };
  }

  /** Stores the scroll position in the current entry of the browser's history. */
  #keepScroll(): void {
    clearTimeout(this.#resting);
    const entry: Entry = { scroll_px: scrollY };
    history.replaceState(entry, '');
  }

  #scrollBack(): void {
    this.#scrolling();
    const { scroll_px } = (history.state as Entry | null) ?? {};
    if (scroll_px === undefined && location.hash !== '') goToFragment(location.hash);
    else this.#scrolling = scrollBack(scroll_px ?? 0);
  }
}

export const place = new Place();
