/** Colour scheme: that of the system, light or dark. */

export type Theme = 'system' | 'light' | 'dark';

const KEY = 'fleetcal.theme';
const ORDER: readonly Theme[] = ['system', 'light', 'dark'];

function stored(): Theme {
  const theme = document.documentElement.dataset.theme;
  return theme === 'light' || theme === 'dark' ? theme : 'system';
}

class Look {
  theme = $state<Theme>(stored());
  /** Counter of colour changes, for content that is drawn instead of styled. */
  changes = $state(0);

  constructor() {
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.changes++);
  }

  /** Changes to the next of system, light, dark. */
  next(): void {
    const theme = ORDER[(ORDER.indexOf(this.theme) + 1) % ORDER.length] ?? 'system';
    this.theme = theme;
    const root = document.documentElement;
    if (theme === 'system') delete root.dataset.theme;
    else root.dataset.theme = theme;
    this.changes++;
    try {
      localStorage.setItem(KEY, theme);
    } catch {
      // Storage is closed to us: the choice holds until the page is left.
    }
  }
}

export const look = new Look();

/** Returns the current colour of a custom property, for a canvas. */
export function colour(property: string): string {
  const probe = document.createElement('span');
  probe.style.color = `var(${property})`;
  document.body.append(probe);
  const value = getComputedStyle(probe).color;
  probe.remove();
  return value;
}
