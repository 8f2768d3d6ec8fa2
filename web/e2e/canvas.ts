/** Texts that pages write on canvases, where no locator reaches. */

import type { Page } from '@playwright/test';

/** A piece of text on a canvas; all sizes in CSS pixels. */
export interface Letters {
  text: string;
  size_px: number;
  /** Its right end. */
  right_px: number;
  /** Width of its canvas. */
  width_px: number;
}

/** Watches what the next page writes on its canvases; the answer gives all of it so far. */
export async function letters(page: Page): Promise<() => Promise<Letters[]>> {
  await page.addInitScript(() => {
    const written: Letters[] = [];
    Object.assign(globalThis, { written });
    const { prototype } = CanvasRenderingContext2D;
    const write = prototype.fillText;
    prototype.fillText = function (text, x, y, ...rest) {
      const share = { start: 1, left: 1, center: 0.5, right: 0, end: 0 }[this.textAlign];
      const right = this.getTransform().transformPoint({ x, y }).x;
      const width = this.measureText(text).width;
      written.push({
        text,
        size_px: Number.parseFloat(this.font) / devicePixelRatio,
        right_px: (right + share * width) / devicePixelRatio,
        width_px: this.canvas.width / devicePixelRatio,
      });
      write.call(this, text, x, y, ...rest);
    };
  });
  return () => page.evaluate(() => (globalThis as unknown as { written: Letters[] }).written);
}
