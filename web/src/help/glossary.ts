/** The glossary of the documentation, as the help page shows it. */

export interface Term {
  term: string;
  meaning: string;
}

/** The rows of the glossary's table; of a link its words stay, of emphasis and code the text. */
export function termsOf(markdown: string): Term[] {
  return markdown.split('\n').flatMap((line) => {
    const [, term, meaning] = /^\| (.+?) \| (.+) \|$/.exec(line) ?? [];
    if (!term || !meaning || term === 'term') return [];
    return [
      { term, meaning: meaning.replace(/\[([^\]]*)\]\([^)]*\)/g, '$1').replace(/[`*]/g, '') },
    ];
  });
}
