/** Repeats a reading only while somebody can see what it is for. */

/**
 * Calls `load` every `every_ms` while `element` is in view, and never before the last call has
 * ended; returns a function that stops it.
 */
export function whileSeen(
  element: Element,
  load: () => Promise<void>,
  every_ms: number,
): () => void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  let seen = false;
  let over = false;
  const again = async () => {
    clearTimeout(timer);
    if (seen && !document.hidden) await load();
    if (!over) timer = setTimeout(() => void again(), every_ms);
  };
  const observer = new IntersectionObserver((entries) => {
    const was = seen;
    seen = entries.at(-1)?.isIntersecting ?? false;
    if (seen && !was) void again();
  });
  observer.observe(element);
  return () => {
    over = true;
    clearTimeout(timer);
    observer.disconnect();
  };
}
