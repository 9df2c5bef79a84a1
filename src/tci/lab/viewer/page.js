// Added to viser's page: shows a message when the viewer has ended, and folds the controls on a telephone.
(() => {
  const told = document.createElement("div");
  told.setAttribute("role", "alert");
  told.textContent = "The viewer has ended, so this page no longer changes. Start it again with: tci view";
  told.style.cssText = "display:none;position:fixed;z-index:9999;top:0;left:0;right:0;padding:10px 16px;" +
    "background:#c92a2a;color:white;font:600 15px system-ui,sans-serif;text-align:center";
  const ask = async () => {
    try {
      await fetch("/alive", { cache: "no-store" });
      told.style.display = "none";
    } catch {
      told.style.display = "block";
    }
    setTimeout(ask, 1000);
  };
  const fold = () => {
    const title = "//div[not(*) and normalize-space()='TCI']";
    const bar = document.evaluate(title, document, null, XPathResult.FIRST_ORDERED_NODE_TYPE).singleNodeValue;
    // Until it is at the bottom: a busy browser first draws another panel there, and then this one, unfolded.
    if (bar?.parentElement.nextElementSibling?.getAttribute("aria-hidden") === "false") bar.click();
    if (!(bar?.getBoundingClientRect().top > innerHeight - 100)) setTimeout(fold, 200);
  };
  addEventListener("load", () => {
    document.body.append(told);
    ask();
    if (innerWidth < 576) fold(); // viser's sheet at the bottom: it would cover the robots
  });
})();
