/** Whether the page is too narrow for a table of eight columns, which then becomes cards. */

const NARROW = '(max-width: 1120px)';

class Viewport {
  narrow = $state(false);

  constructor() {
    const query = matchMedia(NARROW);
    this.narrow = query.matches;
    query.addEventListener('change', () => (this.narrow = query.matches));
  }
}

export const viewport = new Viewport();
