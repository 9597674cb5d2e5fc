/** What this tab calls itself to the server, for as long as it is open: one scene is shared by all that show a recording, and a
 *  click in it means what the screen says on which it was made. */
export const tab = Array.from(crypto.getRandomValues(new Uint8Array(8)), (byte) =>
  byte.toString(16).padStart(2, "0"),
).join("");
