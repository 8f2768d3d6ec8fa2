/** Glossary of the documentation, for the help page. */

export interface Term {
  term: string;
  meaning: string;
}

/** Returns the rows of the glossary's table as plain text. */
export function termsOf(markdown: string): Term[] {
  return markdown.split('\n').flatMap((line) => {
    const [, term, meaning] = /^\| (.+?) \| (.+) \|$/.exec(line) ?? [];
    if (!term || !meaning || term === 'term') return [];
    return [
      { term, meaning: meaning.replace(/\[([^\]]*)\]\([^)]*\)/g, '$1').replace(/[`*]/g, '') },
    ];
  });
}
