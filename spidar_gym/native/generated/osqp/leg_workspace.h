/* Generated: the workspace of OSQP for leg. */
#ifndef LEG_WORKSPACE_H
#define LEG_WORKSPACE_H

#include <stddef.h>
#include <stdint.h>
#include "types.h"
#include "algebra_impl.h"
#include "qdldl_interface.h"

typedef struct {
    OSQPSettings settings;
    OSQPFloat sol_x[24];
    OSQPFloat sol_y[48];
    OSQPFloat sol_prim_inf_cert[48];
    OSQPFloat sol_dual_inf_cert[24];
    OSQPSolution sol;
    OSQPInfo info;
    OSQPInt data_P_csc_p[25];
    OSQPInt data_P_csc_i[84];
    OSQPFloat data_P_csc_x[84];
    OSQPCscMatrix data_P_csc;
    OSQPMatrix data_P;
    OSQPInt data_A_csc_p[25];
    OSQPInt data_A_csc_i[112];
    OSQPFloat data_A_csc_x[112];
    OSQPCscMatrix data_A_csc;
    OSQPMatrix data_A;
    OSQPFloat data_q_val[24];
    OSQPVectorf data_q;
    OSQPFloat data_l_val[48];
    OSQPVectorf data_l;
    OSQPFloat data_u_val[48];
    OSQPVectorf data_u;
    OSQPData data;
    OSQPInt linsys_L_p[73];
    OSQPInt linsys_L_i[176];
    OSQPFloat linsys_L_x[176];
    OSQPCscMatrix linsys_L;
    OSQPFloat linsys_Dinv[72];
    OSQPInt linsys_P[72];
    OSQPFloat linsys_bp[72];
    OSQPFloat linsys_sol[72];
    OSQPFloat linsys_rho_inv_vec[48];
    OSQPInt linsys_KKT_p[73];
    OSQPInt linsys_KKT_i[244];
    OSQPFloat linsys_KKT_x[244];
    OSQPCscMatrix linsys_KKT;
    OSQPInt linsys_PtoKKT[84];
    OSQPInt linsys_AtoKKT[112];
    OSQPInt linsys_rhotoKKT[48];
    OSQPFloat linsys_D[72];
    OSQPInt linsys_etree[72];
    OSQPInt linsys_Lnz[72];
    QDLDL_int linsys_iwork[216];
    QDLDL_bool linsys_bwork[72];
    QDLDL_float linsys_fwork[72];
    qdldl_solver linsys;
    OSQPFloat work_rho_vec_val[48];
    OSQPVectorf work_rho_vec;
    OSQPFloat work_rho_inv_vec_val[48];
    OSQPVectorf work_rho_inv_vec;
    OSQPInt work_constr_type_val[48];
    OSQPVectori work_constr_type;
    OSQPFloat work_x_val[24];
    OSQPVectorf work_x;
    OSQPFloat work_y_val[48];
    OSQPVectorf work_y;
    OSQPFloat work_z_val[48];
    OSQPVectorf work_z;
    OSQPFloat work_xz_tilde_val[72];
    OSQPVectorf work_xz_tilde;
    OSQPVectorf work_xtilde_view;
    OSQPVectorf work_ztilde_view;
    OSQPFloat work_x_prev_val[24];
    OSQPVectorf work_x_prev;
    OSQPFloat work_z_prev_val[48];
    OSQPVectorf work_z_prev;
    OSQPFloat work_Ax_val[48];
    OSQPVectorf work_Ax;
    OSQPFloat work_Px_val[24];
    OSQPVectorf work_Px;
    OSQPFloat work_Aty_val[24];
    OSQPVectorf work_Aty;
    OSQPFloat work_delta_y_val[48];
    OSQPVectorf work_delta_y;
    OSQPFloat work_Atdelta_y_val[24];
    OSQPVectorf work_Atdelta_y;
    OSQPFloat work_delta_x_val[24];
    OSQPVectorf work_delta_x;
    OSQPFloat work_Pdelta_x_val[24];
    OSQPVectorf work_Pdelta_x;
    OSQPFloat work_Adelta_x_val[48];
    OSQPVectorf work_Adelta_x;
    OSQPFloat work_D_temp_val[24];
    OSQPVectorf work_D_temp;
    OSQPFloat work_D_temp_A_val[24];
    OSQPVectorf work_D_temp_A;
    OSQPFloat work_E_temp_val[48];
    OSQPVectorf work_E_temp;
    OSQPWorkspace work;
    OSQPSolver solver;
} leg_space;
extern const leg_space leg_SPACE;
static const uint32_t leg_POINTERS[89] = {
    offsetof(leg_space, sol) + offsetof(OSQPSolution, x), offsetof(leg_space, sol) + offsetof(OSQPSolution, y), offsetof(leg_space, sol) + offsetof(OSQPSolution, prim_inf_cert), offsetof(leg_space, sol) + offsetof(OSQPSolution, dual_inf_cert),
    offsetof(leg_space, data_P_csc) + offsetof(OSQPCscMatrix, p), offsetof(leg_space, data_P_csc) + offsetof(OSQPCscMatrix, i), offsetof(leg_space, data_P_csc) + offsetof(OSQPCscMatrix, x), offsetof(leg_space, data_P) + offsetof(OSQPMatrix, csc),
    offsetof(leg_space, data_A_csc) + offsetof(OSQPCscMatrix, p), offsetof(leg_space, data_A_csc) + offsetof(OSQPCscMatrix, i), offsetof(leg_space, data_A_csc) + offsetof(OSQPCscMatrix, x), offsetof(leg_space, data_A) + offsetof(OSQPMatrix, csc),
    offsetof(leg_space, data_q) + offsetof(OSQPVectorf, values), offsetof(leg_space, data_l) + offsetof(OSQPVectorf, values), offsetof(leg_space, data_u) + offsetof(OSQPVectorf, values), offsetof(leg_space, data) + offsetof(OSQPData, P),
    offsetof(leg_space, data) + offsetof(OSQPData, A), offsetof(leg_space, data) + offsetof(OSQPData, q), offsetof(leg_space, data) + offsetof(OSQPData, l), offsetof(leg_space, data) + offsetof(OSQPData, u),
    offsetof(leg_space, linsys_L) + offsetof(OSQPCscMatrix, p), offsetof(leg_space, linsys_L) + offsetof(OSQPCscMatrix, i), offsetof(leg_space, linsys_L) + offsetof(OSQPCscMatrix, x), offsetof(leg_space, linsys_KKT) + offsetof(OSQPCscMatrix, p),
    offsetof(leg_space, linsys_KKT) + offsetof(OSQPCscMatrix, i), offsetof(leg_space, linsys_KKT) + offsetof(OSQPCscMatrix, x), offsetof(leg_space, linsys) + offsetof(qdldl_solver, L), offsetof(leg_space, linsys) + offsetof(qdldl_solver, Dinv),
    offsetof(leg_space, linsys) + offsetof(qdldl_solver, P), offsetof(leg_space, linsys) + offsetof(qdldl_solver, bp), offsetof(leg_space, linsys) + offsetof(qdldl_solver, sol), offsetof(leg_space, linsys) + offsetof(qdldl_solver, rho_inv_vec),
    offsetof(leg_space, linsys) + offsetof(qdldl_solver, KKT), offsetof(leg_space, linsys) + offsetof(qdldl_solver, PtoKKT), offsetof(leg_space, linsys) + offsetof(qdldl_solver, AtoKKT), offsetof(leg_space, linsys) + offsetof(qdldl_solver, rhotoKKT),
    offsetof(leg_space, linsys) + offsetof(qdldl_solver, D), offsetof(leg_space, linsys) + offsetof(qdldl_solver, etree), offsetof(leg_space, linsys) + offsetof(qdldl_solver, Lnz), offsetof(leg_space, linsys) + offsetof(qdldl_solver, iwork),
    offsetof(leg_space, linsys) + offsetof(qdldl_solver, bwork), offsetof(leg_space, linsys) + offsetof(qdldl_solver, fwork), offsetof(leg_space, work_rho_vec) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_rho_inv_vec) + offsetof(OSQPVectorf, values),
    offsetof(leg_space, work_constr_type) + offsetof(OSQPVectori, values), offsetof(leg_space, work_x) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_y) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_z) + offsetof(OSQPVectorf, values),
    offsetof(leg_space, work_xz_tilde) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_xtilde_view) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_ztilde_view) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_x_prev) + offsetof(OSQPVectorf, values),
    offsetof(leg_space, work_z_prev) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_Ax) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_Px) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_Aty) + offsetof(OSQPVectorf, values),
    offsetof(leg_space, work_delta_y) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_Atdelta_y) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_delta_x) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_Pdelta_x) + offsetof(OSQPVectorf, values),
    offsetof(leg_space, work_Adelta_x) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_D_temp) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_D_temp_A) + offsetof(OSQPVectorf, values), offsetof(leg_space, work_E_temp) + offsetof(OSQPVectorf, values),
    offsetof(leg_space, work) + offsetof(OSQPWorkspace, data), offsetof(leg_space, work) + offsetof(OSQPWorkspace, linsys_solver), offsetof(leg_space, work) + offsetof(OSQPWorkspace, rho_vec), offsetof(leg_space, work) + offsetof(OSQPWorkspace, rho_inv_vec),
    offsetof(leg_space, work) + offsetof(OSQPWorkspace, constr_type), offsetof(leg_space, work) + offsetof(OSQPWorkspace, x), offsetof(leg_space, work) + offsetof(OSQPWorkspace, y), offsetof(leg_space, work) + offsetof(OSQPWorkspace, z),
    offsetof(leg_space, work) + offsetof(OSQPWorkspace, xz_tilde), offsetof(leg_space, work) + offsetof(OSQPWorkspace, xtilde_view), offsetof(leg_space, work) + offsetof(OSQPWorkspace, ztilde_view), offsetof(leg_space, work) + offsetof(OSQPWorkspace, x_prev),
    offsetof(leg_space, work) + offsetof(OSQPWorkspace, z_prev), offsetof(leg_space, work) + offsetof(OSQPWorkspace, Ax), offsetof(leg_space, work) + offsetof(OSQPWorkspace, Px), offsetof(leg_space, work) + offsetof(OSQPWorkspace, Aty),
    offsetof(leg_space, work) + offsetof(OSQPWorkspace, delta_y), offsetof(leg_space, work) + offsetof(OSQPWorkspace, Atdelta_y), offsetof(leg_space, work) + offsetof(OSQPWorkspace, delta_x), offsetof(leg_space, work) + offsetof(OSQPWorkspace, Pdelta_x),
    offsetof(leg_space, work) + offsetof(OSQPWorkspace, Adelta_x), offsetof(leg_space, solver) + offsetof(OSQPSolver, settings), offsetof(leg_space, solver) + offsetof(OSQPSolver, solution), offsetof(leg_space, solver) + offsetof(OSQPSolver, info),
    offsetof(leg_space, solver) + offsetof(OSQPSolver, work),
};

#endif
