import type { ReactNode } from "react";
import css from "./panel.module.css";

interface PanelProps {
  title: string;
  /** One sentence under the title: what to do here. */
  lead?: ReactNode;
  /** Small controls on the title's line. */
  tools?: ReactNode;
  /** The screen's main action; it sits at the same place on every screen. */
  footer?: ReactNode;
  children: ReactNode;
}

/** The right-hand column of every step: title, scrolling content, main action at the bottom. */
export function Panel({ title, lead, tools, footer, children }: PanelProps) {
  return (
    <aside className={css.panel} aria-label={title}>
      <header className={css.head}>
        <div className={css.title}>
          <h1>{title}</h1>
          {tools}
        </div>
        {lead !== undefined && <div className={css.lead}>{lead}</div>}
      </header>
      <div className={css.body} tabIndex={0} role="group" aria-label={`${title}: details`}>
        {children}
      </div>
      {footer !== undefined && <footer className={css.foot}>{footer}</footer>}
    </aside>
  );
}

interface SectionProps {
  title: string;
  tools?: ReactNode;
  children: ReactNode;
}

export function Section({ title, tools, children }: SectionProps) {
  return (
    <section className={css.section} aria-label={title}>
      <div className={css.sectionHead}>
        <h2>{title}</h2>
        {tools}
      </div>
      {children}
    </section>
  );
}
