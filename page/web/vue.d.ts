// <slf-field> in Vue's templates: import type {} from 'slf-field/vue'.
import type {EmitFn, HTMLAttributes, PublicProps} from 'vue';
import type {SlfField, SlfFieldAttributes, SlfFieldEventMap} from './slf-field.js';

type Events = {[K in keyof SlfFieldEventMap]: (event: SlfFieldEventMap[K]) => void};
/** Without events that have another type here. */
type Attributes = Omit<HTMLAttributes, `on${Capitalize<keyof SlfFieldEventMap>}`>;

declare module 'vue' {
  interface GlobalComponents {
    'slf-field': new () => SlfField & {
      $props: Attributes & SlfFieldAttributes & PublicProps,
      $emit: EmitFn<Events>,
    };
  }
}
