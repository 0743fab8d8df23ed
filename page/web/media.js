// What the browser's user has chosen, and time. In Node, which may import this, nothing matches.

export const media = (query) => globalThis.matchMedia?.(query) ?? {matches: false};
export const calm = media('(prefers-reduced-motion: reduce)');
export const sleep = (ms) => new Promise((done) => setTimeout(done, ms));
