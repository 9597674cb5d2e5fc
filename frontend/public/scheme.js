// Sets the colour scheme before the first paint, so that a reload never flashes the other one.
(function () {
  var wish = "auto";
  try {
    wish = localStorage.getItem("unsweep-color-scheme") || "auto";
  } catch (_) {
    // Storage may be switched off; the system's choice is then the answer.
  }
  var dark = wish === "auto" ? matchMedia("(prefers-color-scheme: dark)").matches : wish === "dark";
  document.documentElement.setAttribute("data-mantine-color-scheme", dark ? "dark" : "light");
})();
