// <slf-field> in JSX: import type {} from 'slf-field/react'.
import type {DetailedHTMLProps, HTMLAttributes} from 'react';
import type {SlfField, SlfFieldAttributes, SlfFieldEventMap} from './slf-field.js';

/** React 19 listens to events by these names; React 18 only by addEventListener(). */
type Listeners = {[K in keyof SlfFieldEventMap as `on${K}`]?: (event: SlfFieldEventMap[K]) => void};

declare module 'react' {
  namespace JSX {
    interface IntrinsicElements {
      'slf-field': DetailedHTMLProps<HTMLAttributes<SlfField>, SlfField> & SlfFieldAttributes &
                   Listeners;
    }
  }
}
