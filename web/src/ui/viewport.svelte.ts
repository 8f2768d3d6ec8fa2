/** Whether the page is too narrow for the fleet's table of ten columns, which then becomes cards. */

const NARROW = '(max-width: 1240px)';

class Viewport {
  narrow = $state(false);

  constructor() {
    const query = matchMedia(NARROW);
    this.narrow = query.matches;
    query.addEventListener('change', () => (this.narrow = query.matches));
  }
}

export const viewport = new Viewport();
