import "react";

declare module "react" {
  interface InputHTMLAttributes<T> {
    /** Non-standard in name only: every browser chooses folders by it. `T` is named as in the interface it adds to. */
    webkitdirectory?: T extends HTMLInputElement ? "" : never;
  }
}
