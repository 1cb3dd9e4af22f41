/* Buttons with `data-copy` copy the command before them, or select it if the page may not copy. */
"use strict";
addEventListener("click", async event => {
  const button = event.target.closest("button[data-copy]"), code = button?.previousElementSibling;
  if (!button) return;
  try {
    await navigator.clipboard.writeText(code.textContent);
    button.textContent = "Copied";
  } catch { getSelection().selectAllChildren(code); }
});
