// <slf-field> in Vue's templates: import type {} from 'slf-field/vue'.
import type {DefineComponent} from 'vue';
import type {SlfFieldAttributes} from './slf-field.js';

declare module 'vue' {
  interface GlobalComponents {
    'slf-field': DefineComponent<SlfFieldAttributes>;
  }
}
